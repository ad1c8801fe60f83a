"""Compiled loops: numba's ``njit`` with a cache on disk that follows the code itself.

Numba keeps a compiled function as long as its source file does not change, and does not see that a
function of another file, which it has compiled in, has changed. Here the key is what decides the
machine code: bytecode without docstring, options, the constants read, and the same of every
compiled function called. So a changed docstring compiles nothing again, and a changed function
everything that calls it.
"""

import hashlib
from collections.abc import Callable, Iterator
from types import CodeType, FunctionType
from typing import Any, TypeVar

import numba
import numpy as np
from numba.core import caching

_caching: Any = caching  # its types differ from release to release
_Function = TypeVar("_Function", bound="Callable[..., Any]")


def njit(**options: Any) -> Callable[[_Function], _Function]:
    """Return a decorator that compiles a function when it is first called, and keeps the result.

    Parameters
    ----------
    **options
        Those of ``numba.njit``, without ``cache``. The function must stand in a module, and call
        other compiled functions by their names, not as attributes of a module.
    """

    def compiled(function: _Function) -> _Function:
        dispatcher: Any = numba.njit(**options)(function)
        dispatcher._cache = _Cache(function)
        dispatcher._cache.dispatcher = dispatcher
        return dispatcher  # type: ignore[no-any-return]

    return compiled


def _checksum(dispatcher: Any) -> str:
    """Return a checksum of all that decides a compiled function's machine code."""
    return hashlib.sha256("\n".join(_parts(dispatcher, set())).encode()).hexdigest()


def _parts(value: Any, seen: set[FunctionType]) -> Iterator[str]:
    """Yield what decides a global: a compiled function with all that it reads, or a constant."""
    function = getattr(value, "py_func", None)
    if isinstance(function, FunctionType):
        yield from (f"{name} {_spelled(item)}" for name, item in value.targetoptions.items())
        if function not in seen:  # else it calls itself
            seen.add(function)
            yield from _code(function.__code__, function.__doc__)
            yield repr(function.__defaults__)
            for name in sorted(_names(function.__code__) & function.__globals__.keys()):
                yield name
                yield from _parts(function.__globals__[name], seen)
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.shape} {value.tobytes().hex()}"
    else:
        yield getattr(value, "__name__", None) or _spelled(value)


def _code(code: CodeType, doc: str | None) -> Iterator[str]:
    yield f"{code.co_code.hex()} {code.co_names} {code.co_varnames}"
    for item in code.co_consts:
        if isinstance(item, CodeType):
            yield from _code(item, None)
        elif item != doc:
            yield _spelled(item)


def _names(code: CodeType) -> set[str]:
    inner = (_names(item) for item in code.co_consts if isinstance(item, CodeType))
    return set(code.co_names).union(*inner)


def _spelled(value: Any) -> str:
    return repr(sorted(value) if isinstance(value, set | frozenset) else value)


class _Files(_caching.CompileResultCacheImpl):  # type: ignore[misc]
    """Where numba keeps compiled functions, in files that are called after the function alone."""

    _locator_classes = tuple(
        type(locator.__name__, (locator,), {"get_disambiguator": lambda _: "loop"})
        for locator in _caching.CompileResultCacheImpl._locator_classes
    )


class _Cache(_caching.FunctionCache):  # type: ignore[misc]
    _impl_class = _Files
    dispatcher: Any

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        # Called before anything is read or written, when all that the function calls is defined.
        self._cache_file._source_stamp = _checksum(self.dispatcher)
        return super()._index_key(sig, codegen)
