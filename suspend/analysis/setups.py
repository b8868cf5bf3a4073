"""What makes runs incomparable: the physics of their configurations, and what else differs where they would meet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from suspend.config import loads
from suspend.config.physics import PACKED
from suspend.errors import ConfigurationError
from suspend.io import Run

PHYSICS = ("far_field", "lubrication", "repulsion", "contact", "external")
_FREE_SECTIONS = ("seed", "duration", "output")
_FREE = ("flow.amplitude", "particles.volume_fraction", "particles.number", "particles.frame")


def complete_configuration(run: Run) -> Mapping:
    """The stored configuration with the defaults of keys its version did not have yet; as stored where unreadable."""
    try:
        return loads(run.config_yaml).to_dict()
    except ConfigurationError:
        return run.config


def physics(config: Mapping) -> dict[str, Any]:
    """The terms of the physics by dotted key, and the number of spheres as N: runs that differ are never averaged."""
    return _flat(config, PHYSICS) | {"N": int(config["particles"]["number"])}


def settings(config: Mapping) -> dict[str, Any]:
    """All other keys that may matter, by dotted key: not the seed, the duration, the output, nor what curves run over.

    Files that starts are read from count as one kind of start, as seeds do.
    """
    found = _flat(config, [name for name in config if name not in PHYSICS])
    kept = {key: value for key, value in found.items() if not _free(key)}
    if kept.get("particles.initial") not in (None, *PACKED):
        kept["particles.initial"] = "read from a file"
    return kept


def _free(key: str) -> bool:
    return key in _FREE or key.partition(".")[0] in _FREE_SECTIONS


def _flat(config: Mapping, names: Sequence[str]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name in names:
        section = config.get(name)
        if isinstance(section, Mapping):
            found |= {f"{name}.{key}": value for key, value in section.items()}
        else:
            found[name] = section
    return found


def labels(places: Sequence[tuple], physical: Sequence[dict], other: Sequence[dict]) -> tuple[list[str], list[str]]:
    """The setup of each run as text, "" where all are alike, and the keys that differ without making setups.

    places: (volume fraction, amplitude) of each run. Physics that differs anywhere makes setups. Another key does where
    it has several values at one place under the same physics: there runs would be averaged; one that only goes along
    with volume fraction and amplitude leaves curves whole, and is returned.
    """
    differ = _differing(physical)
    short = [key for key in differ if "." not in key or key.partition(".")[0] not in differ]
    meeting: dict[tuple, list[dict]] = {}
    for place, each, own in zip(places, physical, other, strict=True):
        meeting.setdefault((place, repr([each.get(key) for key in differ])), []).append(own)
    varied = _telling(list(meeting.values()))
    texts = []
    for each, own in zip(physical, other, strict=True):
        parts = [(key, each.get(key, "off")) for key in short] + [(key, own[key]) for key in varied if key in own]
        texts.append(", ".join(f"{key} = {'off' if value is None else value}" for key, value in parts))
    same: dict[str, list[dict]] = {}
    for text, own in zip(texts, other, strict=True):
        same.setdefault(text, []).append(own)
    return texts, sorted({key for group in same.values() for key in _differing(group)})


def _telling(groups: Sequence[Sequence[dict]]) -> list[str]:
    """Keys that tell the entries of every group apart; of those that go together (tolerances, say) the shortest."""
    keys: list[str] = []
    for key in sorted({key for group in groups for key in _differing(group)}, key=lambda k: (k.count("."), k)):
        if any(_kinds(group, [*keys, key]) > _kinds(group, keys) for group in groups):
            keys.append(key)
    return keys


def _kinds(group: Sequence[dict], keys: Sequence[str]) -> int:
    return len({repr([each.get(key) for key in keys]) for each in group})


def _differing(entries: Sequence[dict]) -> list[str]:
    keys = sorted({key for each in entries for key in each})
    return [key for key in keys if len({repr(each.get(key)) for each in entries}) > 1]
