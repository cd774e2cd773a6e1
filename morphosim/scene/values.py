"""Values as files hold them, and dataclasses of them."""

from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from typing import Any

import numpy as np

from morphosim import _validate


def build(cls: type, table: Mapping[str, Any], where: str) -> Any:
    """Instance of a dataclass from a table; ValueError if a key is unknown or missing, or wrong."""
    known = fields(cls) if is_dataclass(cls) else ()
    needed = [f.name for f in known if f.init and f.default is f.default_factory is MISSING]
    _validate.keys(where, table, _validate.names_of(cls), needed)
    try:
        return cls(**table)
    except (TypeError, ValueError) as error:
        raise ValueError(_placed(where, str(error))) from error


def _placed(where: str, error: str) -> str:
    """Error with its place in the file, said once."""
    last = where.rpartition(" ")[2]
    if error.startswith(where):
        return error
    return where.removesuffix(last) + (
        error if error.startswith(f"{last}.") else f"{last}: {error}"
    )


def plain(value: Any) -> Any:
    """Value as TOML can hold it."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [plain(v) for v in value]
    return value


def dataclass_table(item: Any) -> dict[str, Any]:
    """Values of a dataclass but those that are None."""
    values = {name: getattr(item, name) for name in _validate.names_of(type(item))}
    return {name: plain(value) for name, value in values.items() if value is not None}
