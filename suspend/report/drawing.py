"""The figures of a report, each small enough for a phone, as images inside the page."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from suspend.backend import load_matplotlib
from suspend.figures.style import BLACK, BLUE, GREEN, GREY, PALETTE, VERMILION, journal, log_axis_of, say, zero_lines
from suspend.report.examine import Examined

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE = (3.4, 2.6)  # inches: labels of 8 points stay readable on a phone
LARGEST = 150_000  # bytes of an SVG; what is larger becomes a PNG
RESOLUTION = 220  # dots per inch of a PNG
_SINGLE = 40  # fewer points than this are marked
_STRESS = r"$\sigma_{xy}/\eta_0\gamma_0\omega$"


def figure(draw: Callable[[Axes], None], title: str, caption: str) -> str:
    """A figure element: what `draw` draws, as an SVG (or PNG) inside the page; title and caption are HTML."""
    return picture(lambda made: draw(made.add_subplot()), title, caption)


def picture(draw: Callable[[Figure], None], title: str, caption: str, size: tuple[float, float] = SIZE) -> str:
    """As `figure`, for what makes its own axes on a figure of `size` in inches."""
    load_matplotlib()
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with journal():
        matplotlib.rcParams["axes.prop_cycle"] = matplotlib.cycler(color=PALETTE)
        matplotlib.rcParams["svg.hashsalt"] = title  # the same page for the same runs
        made = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(made)
        draw(made)
        kind, data = "svg+xml", _saved(made, "svg", metadata={"Date": None, "Creator": None})
        if len(data) > LARGEST:
            kind, data = "png", _saved(made, "png", dpi=RESOLUTION)
    plain = escape(_without_tags(title), quote=True)
    width, height = (round(96 * inches) for inches in size)
    source = f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
    image = f'<img src="{source}" alt="{plain}" width="{width}" height="{height}">'
    return f"<figure>{image}<figcaption><b>{title}.</b> {caption}</figcaption></figure>"


def _saved(made, kind: str, **options) -> bytes:
    buffer = io.BytesIO()
    made.savefig(buffer, format=kind, **options)
    return buffer.getvalue()


def _without_tags(text: str) -> str:
    import re
    from html import unescape

    return unescape(re.sub(r"<[^>]*>", "", text))


def figures_of(run: Examined) -> list[str]:
    """The figures of one run: those for which it has the data."""
    found = [*(_of_cycles(run) if run.oscillatory else _of_blocks(run)), *_of_structure(run)]
    return [figure(*entry) for entry in found]


def _of_cycles(run: Examined):
    if run.get("moduli") is not None:
        yield (
            lambda ax: _evolution(ax, run, {"eta_r_prime": BLUE, "eta_r_double_prime": VERMILION}),
            "Viscosity and elasticity",
            "η<sub>r</sub>′ and η<sub>r</sub>″ of every cycle against total strain.",
        )
    if run.get("first_cycle") is not None and run.get("last_cycle") is not None:
        for against, name in (("rate", "shear rate"), ("strain", "strain")):
            yield (
                lambda ax, against=against: _loops(ax, run, against, "shear"),
                f"Shear stress against {name}",
                "Lissajous curve of the last cycle, and of the first (dashed).",
            )
    if run.get("moduli") is not None:
        yield (
            lambda ax: _evolution(ax, run, {"minus_eta3_over_eta1": GREEN}),
            "Shear thinning within the cycle",
            "−η<sub>3</sub>′/η<sub>1</sub>′, positive for thinning.",
        )
        yield (
            lambda ax: _normal(ax, run),
            "Average second normal stress difference",
            "ν<sub>0</sub> of N<sub>2</sub> in units of η<sub>0</sub>, whole and in parts.",
        )
    if run.get("last_cycle") is not None:
        yield (
            lambda ax: _loops(ax, run, "strain", "N2"),
            "N<sub>2</sub> against strain",
            "In the last cycle, and in the first (dashed).",
        )
    if run.get("diffusivity") is not None:
        yield (
            lambda ax: _diffusivity(ax, run),
            "Diffusivity per cycle",
            "D<sub>cyc</sub> with the fitted decay; dashed: what the integrator's estimated error could make.",
        )
    if run.get("cloud") is not None:
        yield (
            lambda ax: _cloud(ax, run),
            "Displacements over a cycle",
            f"Every sphere over cycle {run.get('cloud').summary()['cycle']} (counted from 0) in the plane of flow (x) "
            "and gradient (y), in radii.",
        )


def _marker(count: int) -> str | None:
    return "." if count < _SINGLE else None


def _strain_axis(ax: Axes, strain: np.ndarray) -> None:
    log_axis_of(ax, "x", strain, 1.3)
    ax.set_xlabel(r"$\gamma_\mathrm{tot}$")


_LABELS = {
    "eta_r_prime": r"$\eta_r^\prime$",
    "eta_r_double_prime": r"$\eta_r^{\prime\prime}$",
    "minus_eta3_over_eta1": r"$-\eta_3^\prime/\eta_1^\prime$",
}


def _evolution(ax: Axes, run: Examined, columns: dict[str, str]) -> None:
    strain = run.analysis.total_strain
    for name, colour in columns.items():
        values = run.analysis[name]
        ax.plot(strain, values, color=colour, marker=_marker(len(values)), label=_LABELS[name])
    _strain_axis(ax, strain)
    ax.set_ylabel(", ".join(_LABELS[name] for name in columns))
    if len(columns) > 1:
        ax.margins(y=0.2)
        ax.legend(loc="best")


def _loops(ax: Axes, run: Examined, x: str, y: str) -> None:
    for name, style in (("first_cycle", {"color": GREY, "linestyle": "--"}), ("last_cycle", {"color": BLUE})):
        curve = run.get(name)
        if curve is None or (name == "first_cycle" and len(run.analysis.values) == 1):
            continue
        horizontal, vertical = curve.signal(x), curve.signal(y)
        ax.plot(np.append(horizontal, horizontal[0]), np.append(vertical, vertical[0]), **style)
    zero_lines(ax, vertical=True)
    ax.set_xlabel(r"$\dot\gamma/\gamma_0\omega$" if x == "rate" else r"$\gamma/\gamma_0$")
    ax.set_ylabel(_STRESS if y == "shear" else r"$N_2/\eta_0\gamma_0\omega$")


def _normal(ax: Axes, run: Examined) -> None:
    normal, strain = run.get("normal"), run.analysis.total_strain
    colours = {"total": BLACK, "hydrodynamic": BLUE, "interparticle": VERMILION}
    for part, colour in colours.items():
        values = normal.mean_per_cycle("N2", part)
        ax.plot(strain, values, color=colour, marker=_marker(len(values)), label=part)
    zero_lines(ax)
    _strain_axis(ax, strain)
    ax.set_ylabel(r"$\nu_0/\eta_0$ of $N_2$")
    ax.margins(y=0.2)
    ax.legend(loc="best")


def _diffusivity(ax: Axes, run: Examined) -> None:
    found, fit = run.get("diffusivity"), run.get("relaxation")
    values, strain = found.d_cyc, found.total_strain
    ax.set_xlabel(r"$\gamma_\mathrm{tot}$")
    ax.set_ylabel(r"$D_\mathrm{cyc}$")
    if not (values > 0.0).any():
        say(ax, "all displacements are zero" if len(values) else "not known: no positions at the cycles' ends")
        return
    ax.plot(strain, np.where(values > 0.0, values, np.nan), color=BLUE, linestyle="none", marker=".")
    shown = [values]
    if fit is not None and fit.best is not None:
        ax.plot(strain, fit.best(strain), color=BLACK, linewidth=0.8, label=fit.best.name)
        ax.legend(loc="best")
    floor = run.diffusivity_floor
    if floor > 0.0:
        ax.axhline(floor, color=GREY, linestyle="--", linewidth=0.8)
        shown.append([floor])
    _strain_axis(ax, strain)
    log_axis_of(ax, "y", np.concatenate(shown), 1.8)


def _cloud(ax: Axes, run: Examined) -> None:
    cloud = run.get("cloud").displacements
    ax.plot(cloud[:, 0], cloud[:, 1], linestyle="none", marker=".", markersize=2.5, color=BLUE)
    zero_lines(ax, vertical=True)
    reach = 1.1 * max(float(np.abs(cloud[:, :2]).max(initial=0.0)), 1e-12)
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    ax.set_xlabel(r"$\Delta_x/a$")
    ax.set_ylabel(r"$\Delta_y/a$")


def _of_blocks(run: Examined):
    if not run.analysis.cycles.size:
        return
    quiescent = run.analysis.flow == "quiescent"
    name = "sigma_xy" if quiescent else "eta_r"
    parts = {name: "total"} | {f"{name}_{part}": part for part in ("hydrodynamic", "interparticle")}
    yield (
        lambda ax: _blocks(ax, run, parts),
        "Shear stress" if quiescent else "Viscosity",
        "Average of every block of strain, whole and in parts.",
    )
    yield (
        lambda ax: _blocks(ax, run, {"N1": "$N_1$", "N2": "$N_2$"}),
        "Normal stress differences",
        "N<sub>1</sub> and N<sub>2</sub> in units of η<sub>0</sub> times the rate.",
    )
    if run.get("self_diffusion") is not None:
        yield (
            lambda ax: run.get("self_diffusion").plot(ax),
            "Mean square displacement",
            "Against strain, with the displacement by the flow removed.",
        )


def _blocks(ax: Axes, run: Examined, columns: dict[str, str]) -> None:
    strain = run.analysis.total_strain
    for (name, label), colour in zip(columns.items(), (BLACK, BLUE, VERMILION), strict=False):
        if name in run.analysis:
            ax.plot(strain, run.analysis[name], color=colour, marker=_marker(len(strain)), label=label)
    if not any(name.startswith("eta") for name in columns):
        zero_lines(ax)
    ax.set_xlabel(r"$\Gamma t$" if run.analysis.flow == "quiescent" else r"$\gamma_\mathrm{tot}$")
    ax.margins(y=0.2)
    ax.legend(loc="best")


def _of_structure(run: Examined):
    if run.get("pairs_last") is not None:
        yield (
            lambda ax: _pairs(ax, run),
            "Pair distribution",
            "g(r) over the last cycle starts, and of the first configuration (dashed).",
        )
    if run.get("variance") is not None:
        yield (
            lambda ax: _variance(ax, run),
            "Exponent of the number variance",
            "3 for a random gas, 2 for a hyperuniform arrangement; with the paper's form where it fits (line).",
        )
    if run.get("bond_order") is not None and len(run.get("bond_order").global_q6) > 1:
        yield (
            lambda ax: _order(ax, run),
            "Bond order",
            "Q<sub>6</sub> of all bonds (fcc 0.57) and the share of crystalline spheres.",
        )


def _pairs(ax: Axes, run: Examined) -> None:
    for name, style in (("pairs_first", {"color": GREY, "linestyle": "--"}), ("pairs_last", {"color": BLUE})):
        found = run.get(name)
        if found is not None:
            ax.plot(found.r, found.g, linewidth=0.8, **style)
    ax.axhline(1.0, color=GREY, linewidth=0.4, zorder=0)
    ax.set_xlabel("$r/a$")
    ax.set_ylabel("$g(r)$")
    ax.set_xlim(left=1.5)


def _variance(ax: Axes, run: Examined) -> None:
    found = run.get("variance")
    strain = 1.0 + found.total_strain
    ax.errorbar(strain, found.beta, found.error, color=BLUE, linestyle="none", marker=".")
    fit = found.summary()
    if "beta_fit_nu" in fit:
        fine = np.geomspace(1.0, strain[-1], 100)
        ax.plot(fine, found.fit()(fine - 1.0), color=BLACK, linewidth=0.8)
    log_axis_of(ax, "x", strain, 1.3)
    ax.set_xlabel(r"$1 + \gamma_\mathrm{tot}$")
    ax.set_ylabel(r"$\beta$")


def _order(ax: Axes, run: Examined) -> None:
    found = run.get("bond_order")
    strain = 1.0 + found.total_strain
    ax.plot(strain, found.global_q6, color=BLUE, marker="o", label="$Q_6$")
    ax.plot(strain, found.crystal_fraction, color=VERMILION, marker="s", linestyle="--", label="crystalline share")
    ax.set_ylim(0.0, max(0.2, 1.3 * max(found.global_q6.max(), found.crystal_fraction.max())))
    log_axis_of(ax, "x", strain, 1.3)
    ax.set_xlabel(r"$1 + \gamma_\mathrm{tot}$")
    ax.legend(loc="best")
