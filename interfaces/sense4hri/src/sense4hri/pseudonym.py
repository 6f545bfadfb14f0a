"""Where a participant's pseudonym stands, and what is left without it: in texts, names, paths and JSON. Pure.

It is looked for as a whole word (`p1` is not in `p1_b`), and in names and paths also as a part between other signs
(`visit-p1`). `sense4hri-withdraw` and the registry remove by these same rules.
"""

import json
import re
from collections.abc import Collection, Iterable
from typing import Any

from sense4hri import strict_json
from sense4hri.names import folder_name

GONE = "withdrawn"


class Pseudonym:
    """One pseudonym. others: further ones of the study, in which it may be a part (`p1` of `p1_b`).

    A folder is called `p1` for `p1_` too: that name is no trace of the one where it may be the other's.
    """

    def __init__(self, human_id: str, others: Collection[str] = ()) -> None:
        self.human_id = human_id
        taken = {name for other in {*others} - {human_id} for name in (other, folder_name(other))}
        self._names = {human_id} | ({folder_name(human_id)} - taken)
        either = "|".join(sorted(map(re.escape, self._names)))
        self._word = re.compile(rf"(?<!\w)(?:{either})(?!\w)", re.A)
        self._part = re.compile(rf"(?<![A-Za-z0-9])(?:{either})(?![A-Za-z0-9])")
        longer = sorted((name for name in set(others) - self._names if self._part.search(name)), key=len, reverse=True)
        self._others = re.compile(rf"(?<!\w)(?:{'|'.join(map(re.escape, longer))})(?!\w)", re.A) if longer else None

    def mentions(self, text: str) -> bool:
        """True where a text names the pseudonym as a word."""
        return bool(self._word.search(text))

    def half_mentions(self, text: str) -> bool:
        """True where the pseudonym is a part of a longer name (`p1_visit_2`), other pseudonyms set aside."""
        return bool(self._part.search(self._others.sub("", text) if self._others else text))

    def may_be_in(self, data: bytes) -> bool:
        """False for bytes that have no trace."""
        return any(name.encode() in data for name in self._names)

    def is_in(self, value: Any) -> bool:
        """True where any text within a value (list, JSON) mentions the pseudonym."""
        return any(self.mentions(text) for text in json_texts(value))

    def name_without(self, text: str) -> str:
        """A session's or file's name without the pseudonym: `visit-p1` becomes `visit-withdrawn`."""
        return self._part.sub(GONE, text) if self.half_mentions(text) else text

    def path_without(self, text: str) -> str:
        """A path without the pseudonym, in the recorder's layout: part `p1-p2` becomes `p2`, `p1` alone `nobody`."""
        return "/".join(self._step_without(step) for step in text.split("/"))

    def _step_without(self, step: str) -> str:
        people = step.split("-")
        rest = [name for name in people if name not in self._names]
        return self.name_without(step) if len(rest) == len(people) else "-".join(rest) or "nobody"

    def json_without(self, text: str) -> str:
        """JSON text without every key, item and value that mentions the pseudonym; what cannot be read becomes `{}`."""
        if not self.may_be_in(text.encode("utf-8", "replace")):
            return text
        try:
            content = strict_json.parse(text)
        except ValueError:
            return "{}"
        return json.dumps(self.value_without(content)) if self.is_in(content) else text

    def value_without(self, value: Any) -> Any:
        """A value of JSON without whatever mentions the pseudonym."""
        if isinstance(value, dict):
            kept = {key: item for key, item in value.items() if not self.mentions(key) and not self._is_it(item)}
            return {key: self.value_without(item) for key, item in kept.items()}
        if isinstance(value, list):
            return [self.value_without(item) for item in value if not self._is_it(item)]
        return value

    def _is_it(self, item: Any) -> bool:
        if isinstance(item, dict):
            return item.get("human_id") == self.human_id
        return isinstance(item, str) and self.mentions(item)


def json_texts(value: Any) -> Iterable[str]:
    """Every text within a list or JSON, the keys among them."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, list | tuple):
        for item in value:
            yield from json_texts(item)
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from (str(key), *json_texts(item))
