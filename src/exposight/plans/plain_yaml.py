"""YAML by the plain rules of version 1.2: no tags, no aliases, no key twice, no octal numbers."""

import re
from collections.abc import Hashable
from typing import ClassVar

import yaml


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
        known: set[tuple[str, str]] = set()
        for key, _ in node.value:
            problem = ""
            if not isinstance(key, yaml.ScalarNode):
                problem = "a key must be a plain name"
            elif (key.tag, key.value) in known:
                problem = f"the key {key.value!r} is there twice"
            if problem:
                raise yaml.constructor.ConstructorError(None, None, problem, key.start_mark)
            known.add((key.tag, key.value))
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


_LONGEST = 400_000
"""Characters: PyYAML takes 20 s for a million, and TOML is read a hundred times as fast."""


def load_yaml(text: str) -> object:
    """Return the data in one YAML document.

    Raises
    ------
    ValueError
        If it is none, with the line.
    """
    if len(text) > _LONGEST:
        msg = f"it has {len(text)} characters, and may have {_LONGEST}; write it in TOML"
        raise ValueError(msg)
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f" (at line {mark.line + 1}, column {mark.column + 1})" if mark else ""
        msg = f"{', '.join(filter(None, (error.context, error.problem)))}{place}"
        raise ValueError(msg) from error
    except yaml.YAMLError as error:
        raise ValueError(" ".join(str(error).split())) from error
