"""Arrays of files of label images: which axis is which, which time, and how large they may be."""

import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from morphosim import _validate
from morphosim._files import listed
from morphosim.provenance import memory

Steps = Mapping[str, float]
"""Lengths in µm by the letter of an axis."""
UNKNOWN = "q"
"""Letter of an axis of which a file does not say what it is."""
AXES = {"c": "channels", "s": "samples of a colour", "t": "times", "z": "z planes"}
MICROMETRES = {
    "um": 1.0, "μm": 1.0, "micron": 1.0, "microns": 1.0, "micrometer": 1.0, "micrometers": 1.0,
    "micrometre": 1.0, "micrometres": 1.0, "nm": 1e-3, "mm": 1e3, "cm": 1e4, "m": 1e6,
    "inch": 25400.0, "in": 25400.0,
}  # fmt: skip
"""Units of length that files name, in µm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """What of a file is wanted; see `read_labels`."""

    axes: str | None
    key: str | None
    time_index: int | None


def nothing_said() -> Steps:
    """What a file says of voxels that says nothing."""
    return {}


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """What a file holds: labels, the letter of each axis, and what it says in µm, by letter.

    `steps` is the size of a voxel, `first` the position of the first; they are asked for only
    where the user does not say it.
    """

    labels: NDArray[Any]
    letters: str
    steps: Callable[[], Steps] = nothing_said
    first: Callable[[], Steps] = nothing_said


def checked_axes(axes: str | None) -> str | None:
    """Letters of axes as a user gives them, or raise ValueError."""
    if axes is None:
        return None
    letters = str(axes).lower()
    if sorted(letters) not in (sorted("xyz"), sorted("txyz")):
        message = f"axes = {axes!r}: expected the letters x, y, z in the array's order, such as "
        message += "'zyx', or with t, such as 'tzyx'"
        raise ValueError(message)
    return letters


def letters_of(where: str, shape: tuple[int, ...], said: str, default: str, wanted: Wanted) -> str:
    """Letter of each axis: as wanted, else as the file says, else by default.

    Parameters
    ----------
    where : what holds the array, for errors
    shape : of the array
    said : a letter for each axis, `UNKNOWN` where the file does not say it
    default : order of x, y, z where the file says nothing
    wanted : Wanted

    Raises
    ------
    ValueError
        The array is no label image in space; the message says what it is and what to try.
    """
    if said.endswith("s"):
        message = (
            f"{where} is a colour image: axes {said.upper()}, shape {shape}, the last of them the "
            "samples of a colour. Labels have one number per voxel: save the labels themselves"
        )
        raise ValueError(message)
    letters = _filled(said, default) if wanted.axes is None else wanted.axes
    if len(letters) != len(shape):
        message = f"{where} has shape {shape}; expected as many axes as {letters!r} has"
        raise ValueError(message)
    if sorted(letters) not in (sorted("xyz"), sorted("txyz")):
        raise ValueError(_not_in_space(where, shape, said, letters))
    return letters


def _filled(said: str, default: str) -> str:
    """Letters of a file with those that it does not say: by default, or z planes, then times."""
    if set(said) == {UNKNOWN} and len(said) in (3, 4):
        return ("t" if len(said) == 4 else "") + default
    letters = list(said)
    for missing in "zt":
        if UNKNOWN in letters and missing not in letters:
            letters[len(letters) - 1 - letters[::-1].index(UNKNOWN)] = missing
    return "".join(letters)


def _not_in_space(where: str, shape: tuple[int, ...], said: str, letters: str) -> str:
    """What an array is that has not the axes x, y, z and at most t, and what to try."""
    parts = [
        f"{n} {AXES[a]}" for a, n in zip(said, shape, strict=True) if a in AXES and n != 1
    ] or ["one plane" if len(shape) == 2 else f"{len(shape)} axes"]
    advice = "expected x, y, z and at most t"
    if "c" in said or "s" in said:
        advice += ": save the channel of the labels alone"
    if len(shape) == 3 and "z" not in letters:
        advice += "; if these are z planes after all, give axes = 'zyx'"
    elif UNKNOWN in letters:
        advice += "; give axes"
    return f"{where} has shape {shape}, with axes {said.upper()} ({', '.join(parts)}): {advice}"


def at_time(where: str, values: Any, letters: str, time_index: int | None) -> tuple[Any, str]:
    """Labels at one time, and their axes; nothing is read yet where `values` is lazy."""
    if "t" not in letters:
        if time_index is not None:
            message = f"{where} has no time axis (axes {letters!r}), but time_index = {time_index}"
            raise ValueError(message)
        return values, letters
    axis = letters.index("t")
    count = values.shape[axis]
    if time_index is None and count != 1:
        message = f"{where} holds {count} times; choose one by time_index, 0 to {count - 1}"
        raise ValueError(message)
    chosen = _validate.integer("time_index", time_index or 0, least=-count)
    if chosen >= count:
        message = f"time_index = {chosen}, but {where} holds {count} times (0 to {count - 1})"
        raise ValueError(message)
    index = (slice(None),) * axis + (chosen,)
    return values[index], letters.replace("t", "")


def chosen_name(name: str, key: str | None, known: Iterable[str], likely: Sequence[str]) -> str:
    """Return the name asked for, or the only likely one."""
    if key is not None:
        _validate.choice(name, key, known)
        return key
    if len(likely) != 1:
        message = f"{name}: {len(likely)} could be the labels; choose one by key out of "
        raise ValueError(message + listed(list(known)))
    return likely[0]


def unit(name: str, said: str) -> float:
    """Return a unit of length in µm, or raise ValueError."""
    plain = unicodedata.normalize("NFKC", said).strip()
    _validate.choice(f"unit of {name}", plain if plain in MICROMETRES else said, MICROMETRES)
    return MICROMETRES[plain]


def check_memory(where: str, size: int) -> None:
    """Raise ValueError if an array of so many bytes is more than the machine has memory for."""
    if size > memory():
        message = (
            f"{where} says that it holds {size / 1e9:.4g} GB, and the machine has "
            f"{memory() / 1e9:.4g} GB of memory: the file is damaged, or take a part of the image"
        )
        raise ValueError(message)
