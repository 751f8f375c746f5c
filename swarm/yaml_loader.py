"""PyYAML, kept apart from the door for texts: it is loaded only once a YAML text is read."""

from typing import Any

import yaml


class DamagedYaml(Exception):
    """A text that is no YAML, or has an alias. The message is PyYAML's; line: number of the line, None if not known."""

    def __init__(self, problem: str, line: int | None) -> None:
        """Keep what is wrong, and where."""
        super().__init__(problem)
        self.line = line


class _Loader(yaml.SafeLoader):  # type: ignore[misc]  # the library has no types
    """YAML without anchors, by which a short text grows without bounds, or contains itself."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            raise yaml.constructor.ConstructorError(
                None, None, "an alias (*) has no place here", self.peek_event().start_mark
            )
        return super().compose_node(parent, index)


def load_yaml(text: str) -> Any:
    """Return the value of a YAML text.

    Raises:
        DamagedYaml: the text breaks the rules of YAML.
    """
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        raise DamagedYaml(str(error.problem), None if mark is None else mark.line + 1) from None
    except yaml.YAMLError as error:
        raise DamagedYaml(str(error).splitlines()[0], None) from None
