"""Which condition each sequence of KAIST was driven in."""

from __future__ import annotations

import csv
import sys
from collections.abc import Sequence
from pathlib import Path

from everplace.errors import ConfigError
from everplace.files import readable

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

__all__ = ["condition_of", "read_conditions"]

# The twelve sets of the pedestrian benchmark (Hwang et al., CVPR 2015). The sets of the place-recognition drives
# are not published with their times of day, so the user says them.
_KNOWN = {f"set{number:02d}": "day" if number // 3 % 2 == 0 else "night" for number in range(12)}


def read_conditions(given: Sequence[str]) -> dict[str, str]:
    """Reads what the user says about conditions: `set00:day`, or a file.

    Args:
        given: Items SET:CONDITION or SET/VIDEO:CONDITION, or one file: a CSV with the columns sequence, condition
            or a TOML file of such keys with their conditions.

    Returns:
        Condition by set, or by set and video.

    Raises:
        ConfigError: An item is neither, or the file is missing or malformed.
    """
    if len(given) == 1 and given[0].lower().endswith((".csv", ".toml")):
        return _from_file(Path(given[0]))
    table: dict[str, str] = {}
    for item in given:
        key, colon, condition = item.partition(":")
        if not colon or not key.strip() or not condition.strip():
            raise ConfigError(
                f"conditions={item!r} cannot be: write SET:CONDITION, like set00:day,set03/V001:night, or name a "
                "CSV or TOML file"
            )
        table[key.strip()] = condition.strip()
    return table


def condition_of(table: dict[str, str], key: str) -> str:
    """Returns the condition of `SET/VIDEO`: what is said about it, about its set, or is known; else empty."""
    for name in (key, key.partition("/")[0]):
        if name in table:
            return table[name]
    return _KNOWN.get(key.partition("/")[0], "")


def _from_file(path: Path) -> dict[str, str]:
    try:
        text = path.read_text(encoding="utf-8-sig")
        rows = _toml_rows(text) if path.suffix.lower() == ".toml" else _csv_rows(text)
    except OSError as error:
        raise ConfigError(f"cannot read {readable(path)}: {error.strerror or error}; check conditions=") from error
    except (ValueError, RecursionError, csv.Error) as error:
        raise ConfigError(
            f"{readable(path)} is not a table of sequences and conditions ({error}); correct it"
        ) from error
    return rows


def _toml_rows(text: str) -> dict[str, str]:
    table = tomllib.loads(text)
    for key, value in table.items():
        if not isinstance(value, str) or not value:
            raise ValueError(f"{key!r} must be a text, like {key!r} = 'day'")
    return table


def _csv_rows(text: str) -> dict[str, str]:
    lines = [line for line in csv.reader(text.splitlines(), strict=True) if line]
    if not lines or [name.strip() for name in lines[0][:2]] != ["sequence", "condition"]:
        raise ValueError("its first line must be sequence,condition")
    table: dict[str, str] = {}
    for line in lines[1:]:
        if len(line) < 2 or not line[0].strip() or not line[1].strip():
            raise ValueError(f"the line {','.join(line)!r} must hold a sequence and a condition")
        table[line[0].strip()] = line[1].strip()
    return table
