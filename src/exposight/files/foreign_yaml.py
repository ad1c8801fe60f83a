"""YAML of others, checked for what makes small files eat the machine before it is loaded."""

import yaml

from exposight.errors import FormatError

MOST_YAML_NODES = 200_000
"""Keys, values and entries of lists."""

DEEPEST_YAML = 30

# libyaml's parsers where they are, ten times as fast.
BaseLoader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
SafeLoader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def check_yaml(text: str) -> None:
    """Refuse aliases, merge keys, deep nesting and endless content, event by event.

    Faults of syntax are left to the loader, which meets the same ones.

    Raises
    ------
    FormatError
        If there are any; the message has the line and no path.
    """
    depth = 0
    try:
        for count, event in enumerate(yaml.parse(text, Loader=BaseLoader)):
            if isinstance(event, yaml.CollectionStartEvent):
                depth += 1
            elif isinstance(event, yaml.CollectionEndEvent):
                depth -= 1
            fault = ""
            if isinstance(event, yaml.AliasEvent):
                fault = "an alias; write out what it stands for"
            elif isinstance(event, yaml.ScalarEvent) and event.value == "<<":
                fault = "a merge key; write out what it stands for"
            elif depth > DEEPEST_YAML:
                fault = f"it is nested more than {DEEPEST_YAML} deep"
            elif count > MOST_YAML_NODES:
                fault = f"more than {MOST_YAML_NODES} keys and values"
            if fault:
                msg = f"line {event.start_mark.line + 1}: {fault}"
                raise FormatError(msg)
    except (yaml.YAMLError, UnicodeError):
        return
