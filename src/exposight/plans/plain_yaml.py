"""YAML as measuring plans use it: values that can be read in one way only.

PyYAML's safe loader, which makes plain data and nothing else, with the core schema of YAML 1.2 in
place of 1.1's: ``no`` is a word, ``010`` is ten, ``1:30`` and dates are texts. A key that is there
twice is refused, and so are tags, and aliases, which would let a short file stand for a huge one.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, ClassVar

import yaml

if TYPE_CHECKING:
    from collections.abc import Hashable


class _Loader(yaml.SafeLoader):  # type: ignore[misc]  # PyYAML carries no types
    """The safe loader, restricted as the module says."""

    yaml_implicit_resolvers: ClassVar[dict[str, object]] = {}  # those of YAML 1.2 follow below

    def compose_node(self, parent: yaml.Node | None, index: object) -> yaml.Node | None:
        event = self.peek_event()
        problem = ""
        if isinstance(event, yaml.AliasEvent):
            problem = f"the alias *{event.anchor} is not allowed here; write the value out"
        elif getattr(event, "tag", None) is not None:
            problem = f"the tag {event.tag} is not allowed here; leave it out"
        if problem:
            raise yaml.composer.ComposerError(None, None, problem, event.start_mark)
        return super().compose_node(parent, index)

    def construct_mapping(
        self, node: yaml.MappingNode, deep: bool = False
    ) -> dict[Hashable, object]:
        seen: set[tuple[str, str]] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                problem = "a key must be a plain name"
                raise yaml.constructor.ConstructorError(None, None, problem, key.start_mark)
            if (key.tag, key.value) in seen:
                problem = f"the key {key.value!r} is there twice"
                raise yaml.constructor.ConstructorError(None, None, problem, key.start_mark)
            seen.add((key.tag, key.value))
        return super().construct_mapping(node, deep)  # type: ignore[no-any-return]

    def construct_decimal(self, node: yaml.ScalarNode) -> int:
        return int(self.construct_scalar(node))


# Section 10.3.2 of the YAML 1.2.2 specification, without its octal and hexadecimal numbers.
for _tag, _pattern, _first in (
    ("null", "null|Null|NULL|~|", "nN~"),
    ("bool", "true|True|TRUE|false|False|FALSE", "tTfF"),
    ("int", "[-+]?[0-9]+", "-+0123456789"),
    (
        "float",
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        "-+.0123456789",
    ),
):
    _Loader.add_implicit_resolver(
        f"tag:yaml.org,2002:{_tag}", re.compile(f"^(?:{_pattern})$"), [*_first]
    )
_Loader.add_implicit_resolver("tag:yaml.org,2002:null", re.compile("^$"), [""])
_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_decimal)


def load_yaml(text: str) -> object:
    """Return the data in a YAML document.

    Parameters
    ----------
    text : str
        One document.

    Raises
    ------
    ValueError
        If it is not YAML, a key is there twice, or it uses a tag or an alias. The message names the
        line.
    """
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f" (at line {mark.line + 1}, column {mark.column + 1})" if mark else ""
        msg = f"{', '.join(filter(None, (error.context, error.problem)))}{place}"
        raise ValueError(msg) from error
    except yaml.YAMLError as error:
        raise ValueError(" ".join(str(error).split())) from error
    except RecursionError as error:
        msg = "it is nested too deeply"
        raise ValueError(msg) from error
