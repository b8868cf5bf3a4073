"""Texts of `info`, JSON, and writing of small files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from suspend.config import loads
from suspend.errors import ConfigurationError
from suspend.io.files import replace_text, storage_errors
from suspend.missing import plain, text


def to_json(content: Any) -> str:
    """JSON of plain or NumPy values; what has no value is null."""
    return json.dumps(plain(content), indent=2, allow_nan=False)


def information(content: Mapping[str, Any]) -> dict[str, Any]:
    """What `suspend.io.describe` says, the configuration as keys, and the number of cycles it asks for."""
    from suspend.flow import make_flow

    result = dict(content)
    try:
        config = loads(content["config_yaml"], source="configuration stored with the run")
    except ConfigurationError as error:
        return result | {"configuration": None, "configuration_problem": str(error), "cycles_total": None}
    # more where a steady run was extended: it keeps the shorter blocks it was begun with
    total = max(make_flow(config).cycles, content["cycles"])
    return result | {"configuration": config.to_dict(), "cycles_total": total}


def description(content: Mapping[str, Any]) -> list[str]:
    """Lines of `suspend info`."""
    total = content["cycles_total"]
    left = sorted(set(content) - SAID)
    entries = [
        ("run", content["path"]),
        ("state", _state(content)),
        ("cycles", f"{content['cycles']}" + (f" of {total}" if total is not None else "")),
        *_scene(content["configuration"]),
        ("samples, frames", f"{content['samples']}, {content['frames']}"),
        ("last sample", _last_sample(content)),
        ("size on disk", _size(content["bytes"])),
        *((name, content[name]) for name in left if not isinstance(content[name], Mapping)),
        *_flat("", content["meta"]),
        *_flat("", content["statistics"]),
        *_flat("checkpoint ", content["checkpoint"] or {}),
    ]
    if content.get("configuration_problem"):
        entries.append(("configuration", content["configuration_problem"]))
    width = max(len(name) for name, _ in entries) + 2
    return [
        f"{name.replace('_', ' ').ljust(width)}{_text(value)}" for name, value in entries if value is not None
    ]


SAID = {
    *(
        "path",
        "finished",
        "running",
        "cycles",
        "cycles_total",
        "configuration",
        "configuration_problem",
        "samples",
    ),
    *(
        "frames",
        "time",
        "strain",
        "bytes",
        "meta",
        "statistics",
        "checkpoint",
        "config_yaml",
        "fields",
        "pending",
    ),
    "incomplete_cycle",
}


def _state(content: Mapping[str, Any]) -> str:
    if content["running"]:
        return f"running ({content['running']})"
    return (
        "finished" if content["finished"] else "unfinished; `suspend run` with its configuration continues it"
    )


def _scene(config: Mapping[str, Any] | None) -> list[tuple[str, str]]:
    if config is None:
        return []
    particles, flow = config["particles"], {k: v for k, v in config["flow"].items() if k != "type"}
    terms = [f"far field {config['far_field']}", "lubrication"] if config["lubrication"]["enabled"] else []
    terms += [name for name in ("repulsion", "contact", "external") if config[name] is not None]
    return [
        ("spheres", f"{particles['number']}, volume fraction {particles['volume_fraction']:g}"),
        ("flow", f"{config['flow']['type']}, " + ", ".join(f"{k} {v:g}" for k, v in flow.items())),
        ("terms", ", ".join(terms) or "none"),
        ("seed", str(config["seed"])),
    ]


def _last_sample(content: Mapping[str, Any]) -> str | None:
    if content["time"] is None:
        return None
    return f"time {content['time']:g}, strain {content['strain']:g}"


def _flat(prefix: str, content: Mapping[str, Any]) -> list[tuple[str, Any]]:
    found: list[tuple[str, Any]] = []
    for name, value in content.items():
        if isinstance(value, Mapping):
            found += _flat(f"{prefix}{name} ", value)
        else:
            found.append((prefix + name, value))
    return found


def _size(count: int) -> str:
    size, units = float(count), ["B", "kB", "MB", "GB", "TB"]
    while size >= 1000.0 and len(units) > 1:
        size /= 1000.0
        units.pop(0)
    return f"{size:.3g} {units[0]}"


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return text(value) if isinstance(value, float) else str(value)


def write_text(path: Path, text: str, force: bool) -> None:
    """Write a small file, whole or not at all. ConfigurationError if a regular file exists and `force` is not set."""
    if path.is_dir():
        raise ConfigurationError(f"{path}: is a folder; give the name of a file")
    if path.is_file() and not force:
        raise ConfigurationError(f"{path}: exists already; --force overwrites it")
    with storage_errors("write", path):
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_text(path, text)
