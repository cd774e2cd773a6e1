"""Values as files hold them, and dataclasses of them."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from morphosim import _validate


def build(cls: type, table: Mapping[str, Any], where: str) -> Any:
    """Instance of a dataclass from a table; unknown and missing keys are errors."""
    _validate.keys(where, table, _validate.names_of(cls))
    try:
        return cls(**table)
    except TypeError as error:
        message = f"{where}: {error}"
        raise ValueError(message) from error


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
