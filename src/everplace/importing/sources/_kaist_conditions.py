"""Which condition each sequence of KAIST was driven in."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from everplace.errors import ConfigError, RouteError
from everplace.files import readable
from everplace.route.csv_table import CsvTable

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
        if path.suffix.lower() == ".toml":
            table = tomllib.loads(path.read_text(encoding="utf-8-sig"))
        else:
            columns = ("sequence", "condition")
            table = {row.cells[columns[0]].strip(): row.cells[columns[1]].strip() for row in CsvTable(path, columns)}
    except OSError as error:
        raise ConfigError(f"cannot read {readable(path)}: {error.strerror or error}; check conditions=") from error
    except (ValueError, RecursionError, RouteError) as error:
        reason = str(error).partition(";")[0]
        raise ConfigError(
            f"{readable(path)} is not a table of sequences and conditions ({reason}); correct it"
        ) from error
    for key, value in table.items():
        if not key or not isinstance(value, str) or not value:
            raise ConfigError(
                f"{readable(path)} is not a table of sequences and conditions ({key!r} must have a text, like 'day'); "
                "correct it"
            )
    return table
