"""YAML as ROS reads parameters (rcl_yaml_param_parser): other words are numbers and truth values than in YAML 1.1.

`y` is true and `1e3` a number; `null`, `1_000` and `11:22` are texts. A list holds values of one type.
"""

import math
import re
from typing import Any, ClassVar

import yaml

TRUE = re.compile(r"y|Y|yes|Yes|YES|on|On|ON|true|True|TRUE")
FALSE = re.compile(r"n|N|no|No|NO|off|Off|OFF|false|False|FALSE")
WHOLE = re.compile(r"(?P<sign>[-+]?)(?:0[xX](?P<hex>[0-9a-fA-F]+)|0(?P<octal>[0-7]+)|(?P<decimal>0|[1-9][0-9]*))")
REAL = re.compile(r"[-+]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|(?i:inf|infinity|nan))")
BASES = {"hex": 16, "octal": 8, "decimal": 10}


def load(text: str) -> Any:
    """Return the value of a text. Raises yaml.YAMLError."""
    return yaml.load(text, _Loader)


class _Loader(yaml.SafeLoader):
    yaml_implicit_resolvers: ClassVar[dict[str, Any]] = {}

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.constructor.ConstructorError(problem="ROS reads no anchors: write out what * stands for")
        return super().compose_node(parent, index)

    def text_or_more(self, node: yaml.ScalarNode) -> Any:
        return node.value if node.style else _plain(node.value)

    def list_of_one_type(self, node: yaml.SequenceNode) -> list[Any]:
        values = self.construct_sequence(node, deep=True)
        if len({type(value) for value in values}) > 1:
            raise yaml.constructor.ConstructorError(
                None, None, "must be values of one type, as in [1.0, 2.5]", node.start_mark
            )
        return values


_Loader.add_constructor("tag:yaml.org,2002:str", _Loader.text_or_more)
_Loader.add_constructor("tag:yaml.org,2002:seq", _Loader.list_of_one_type)


def _plain(text: str) -> Any:
    """Return the value of a text without quotes."""
    if TRUE.fullmatch(text) or FALSE.fullmatch(text):
        return bool(TRUE.fullmatch(text))
    if whole := WHOLE.fullmatch(text):
        return next(int(f"{whole['sign']}{whole[name]}", base) for name, base in BASES.items() if whole[name])
    if REAL.fullmatch(special := re.sub(r"^([-+]?)\.(?=inf|nan)", r"\1", text, flags=re.I)):
        number = float(special)
        return text if math.isinf(number) and special[-1].isdigit() else number  # out of range is a text
    return text or None
