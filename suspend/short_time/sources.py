"""What to compute short-time properties of: random packings, a configuration (YAML), or a file with positions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from suspend.config import Config, from_dict, load
from suspend.errors import ConfigurationError
from suspend.oneshot.problem_files import method_of
from suspend.oneshot.scene import Method, PeriodicScene
from suspend.packing import PACKINGS
from suspend.short_time.ensemble import packed_scenes

NUMBER, CONFIGURATIONS, SEED = 500, 4, 1
CONTACT = 1e-6  # smallest gap of packings that no file describes: hard spheres of radius a
YAML = (".yaml", ".yml")


@dataclass(frozen=True)
class Request:
    """What the user asks for; None: the file's, or the default."""

    path: str | None = None
    volume_fraction: float | None = None
    number: int | None = None
    configurations: int | None = None
    seed: int | None = None
    far_field: str | None = None
    lubrication: bool = True
    accuracy: float = 1e-3
    overrides: tuple[str, ...] = ()
    threads: int = 1

    def configured(self) -> list[str]:
        """The choices of method as overrides of a configuration."""
        chosen = [f"tolerance={self.accuracy!r}"]
        if self.far_field is not None:
            chosen.append(f"far_field={self.far_field}")
            if self.far_field != "ewald":  # what a file says of the far field that is off
                chosen += ["ewald=null", "solver.far_tolerance=null"]
        if not self.lubrication:
            chosen.append("lubrication.enabled=false")
        return chosen + list(self.overrides)


@dataclass(frozen=True)
class Ensemble:
    """Scenes, made one by one when asked for, and how to treat them."""

    scenes: Iterator[PeriodicScene]
    configurations: int
    method: Method
    seed: int
    source: str
    random: bool  # packings of hard spheres made here


def read_ensemble(request: Request) -> Ensemble:
    """The ensemble of a request. Raises ConfigurationError (not usable) and StorageError (cannot be read)."""
    if request.path is None:
        if request.volume_fraction is None:
            raise ConfigurationError("give --phi for random packings, or a file (YAML or with positions)")
        return _from_configuration(_bare(request, request.number or NUMBER, request.volume_fraction), request)
    for option, given in (("--phi", request.volume_fraction), ("--number", request.number)):
        if given is not None:
            raise ConfigurationError(f"{option}: is for random packings without a file; {request.path} says what it is")
    if Path(request.path).suffix.lower() in YAML:
        return _from_configuration(load(request.path, request.configured()), request)
    return _one(Path(request.path), -1, _bare(request, 2, 0.1), request)


def _bare(request: Request, number: int, volume_fraction: float) -> Config:
    """Configuration of defaults (far field ewald) and the request's choices."""
    base = {
        "particles": {"number": number, "volume_fraction": volume_fraction, "minimum_gap": CONTACT},
        "flow": {"type": "quiescent"},
        "duration": {"strain": 1.0},
        "far_field": "ewald",
    }
    return from_dict(base, source="command line", overrides=request.configured())


def _from_configuration(config: Config, request: Request) -> Ensemble:
    particles = config.particles
    if particles.initial not in PACKINGS:
        return _one(Path(config.directory) / particles.initial, particles.frame, config, request)
    file_seed = SEED if request.path is None else config.seed
    seed = request.seed if request.seed is not None else file_seed
    count = request.configurations or CONFIGURATIONS
    scenes = packed_scenes(
        particles.initial, particles.number, particles.volume_fraction, count, seed, particles.minimum_gap
    )
    kind = "random packings" if particles.initial == "equilibrium" else f"{particles.initial} packings"
    source = kind if request.path is None else f"{kind} of {request.path}"
    return Ensemble(scenes, count, _method(config, request), seed, source, True)


def _one(path: Path, frame: int, config: Config, request: Request) -> Ensemble:
    """The one configuration of a file with positions; lengths are divided by its radius, if it gives one."""
    from suspend.initial import load_configuration

    if request.configurations not in (None, 1):
        raise ConfigurationError(f"--configurations: found {request.configurations}; {path} holds one configuration")
    loaded = load_configuration(path, frame)
    radius = loaded.radius if loaded.radius is not None else 1.0
    scene = PeriodicScene(loaded.positions / radius, loaded.length / radius, loaded.tilt)
    seed = request.seed if request.seed is not None else SEED
    return Ensemble(iter([scene]), 1, _method(config, request), seed, str(path), False)


def _method(config: Config, request: Request) -> Method:
    named = {entry.partition("=")[0].strip() for entry in request.overrides}
    return method_of(config, named, request.accuracy, request.threads)
