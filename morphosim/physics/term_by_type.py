"""Force terms whose strength is one number, and others for cells of some types."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Self

from morphosim.physics.by_type import ByType
from morphosim.physics.term import Term


@dataclass(frozen=True, slots=True, kw_only=True)
class TermByType(Term):
    """A term that acts where its strength is not 0; the strength is a field and its `…_by_type`."""

    @property
    def strengths(self) -> ByType:
        """The strength, by type; the last part of its name is that of the field."""
        raise NotImplementedError

    @property
    def present(self) -> bool:
        """Whether it acts on any cell."""
        return self.strengths.acts

    def check(self, names: Collection[str], types: Collection[str]) -> None:
        """Raise ValueError if a strength is that of a type that is not one of these."""
        self.strengths.check(types)

    def among(self, names: Collection[str], types: Collection[str]) -> Self:
        """Copy that says nothing of other types than these."""
        field = self.strengths.name.rpartition(".")[2]
        return replace(self, **{f"{field}_by_type": self.strengths.among(types)})
