"""Which run a file is of, and from which run that one started."""

from dataclasses import dataclass, field
from typing import Any
from uuid import uuid4


def _new_id() -> str:
    return uuid4().hex[:16]


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """What tells a run from all others.

    Attributes
    ----------
    id : text that no other run has; it stays when the run goes on
    source : path of the run from whose saved fields it started; "" for none
    source_id : id of that run; "" where it is not known
    source_time : *in silico* time of the save that it started from
    """

    id: str = field(default_factory=_new_id)
    source: str = ""
    source_id: str = ""
    source_time: float = 0.0

    @property
    def attributes(self) -> dict[str, Any]:
        """Attributes of a save."""
        own = {"run_id": self.id}
        if not self.source:
            return own
        return own | {
            "from_run": self.source, "from_run_id": self.source_id, "from_time": self.source_time,
        }  # fmt: skip
