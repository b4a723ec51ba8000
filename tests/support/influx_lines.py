"""A strict reader of InfluxDB's line protocol, by its documented grammar."""

import re
from typing import Any

_KEY = r'(?:[^,= \\\n"]|\\[,= ])+'
_STRING = r'"(?:[^"\\\n]|\\["\\])*"'
_FLOAT = r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?"
_VALUE = rf"(?:{_STRING}|{_FLOAT}|-?\d+i|t|f)"
_LINE = re.compile(
    rf"(?P<measurement>(?:[^, \\\n]|\\[, ])+)"
    rf"(?P<tags>(?:,{_KEY}={_KEY})*)"
    rf" (?P<fields>{_KEY}={_VALUE}(?:,{_KEY}={_VALUE})*)"
    rf" (?P<stamp>-?\d+)"
)


def parse_line(line: str) -> tuple[str, dict[str, str], dict[str, Any], int]:
    """Return measurement, tags, fields and time; ValueError for what is no line."""
    match = _LINE.fullmatch(line)
    if match is None:
        raise ValueError(line)
    pairs = [pair.split("=") for pair in match["tags"].split(",")[1:]]
    if [key for key, _ in pairs] != sorted(key for key, _ in pairs):
        raise ValueError(f"tags are not sorted: {line}")
    fields = {
        key: _value(value)
        for key, value in re.findall(rf"({_KEY})=({_VALUE})", match["fields"])
    }
    return match["measurement"], dict(pairs), fields, int(match["stamp"])


def _value(text: str) -> Any:
    if text.startswith('"'):
        return re.sub(r'\\(["\\])', r"\1", text[1:-1])
    if text.endswith("i"):
        return int(text[:-1])
    return text == "t" if text in "tf" else float(text)
