"""Numbers as people write them, and the few pieces of HTML a report is made of."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape

from suspend.missing import has_value

UNKNOWN = "–"


def number(value: float | int | None, digits: int = 4) -> str:
    """A number with `digits` significant digits as HTML; a dash where it is not known."""
    if not has_value(value):
        return UNKNOWN
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\u202f")
    if value != 0.0 and not 1e-3 <= abs(value) < 1e5:
        mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
        mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
        return f"{_minus(mantissa)}&nbsp;×&nbsp;10<sup>{_minus(str(int(exponent)))}</sup>"
    return _minus(f"{value:.{digits}g}")


def with_error(value: float, error: float) -> str:
    """Value and error as HTML, both to the second digit of the error; an error of round-off alone is none."""
    if not (math.isfinite(value) and math.isfinite(error)) or error <= 1e-9 * abs(value):
        return number(value)
    exponent = math.floor(math.log10(max(abs(value), error)))
    power = exponent if not -3 <= exponent < 5 else 0
    value, error = value / 10.0**power, error / 10.0**power
    places = max(0, 1 - math.floor(math.log10(error)))
    text = f"{_minus(f'{value:.{places}f}')}&nbsp;±&nbsp;{error:.{places}f}"
    return f"({text})&nbsp;×&nbsp;10<sup>{_minus(str(power))}</sup>" if power else text


def percent(fraction: float) -> str:
    """A fraction in percent with its sign, two digits."""
    return _minus(f"{100.0 * fraction:+.2g}") + "&nbsp;%" if math.isfinite(fraction) else UNKNOWN


def duration(seconds: float) -> str:
    """A wall time in the two largest units."""
    if not math.isfinite(seconds):
        return UNKNOWN
    if seconds < 120.0:
        return f"{seconds:.3g}&nbsp;s"
    minutes, hours = seconds / 60.0, seconds / 3600.0
    if hours < 2.0:
        return f"{minutes:.3g}&nbsp;min"
    return f"{hours:.3g}&nbsp;h" if hours < 48.0 else f"{hours / 24.0:.3g}&nbsp;d"


def _minus(text: str) -> str:
    return text.replace("-", "−")


def table(rows: Iterable[Sequence[str]], head: Sequence[str] | None = None, kind: str = "") -> str:
    """A table in a box that scrolls sideways on narrow screens; cells are HTML, the first of a row names it."""
    lines = [f'<div class="wide"><table class="{kind}">']
    if head is not None:
        lines.append("<thead><tr>" + "".join(f'<th scope="col">{cell}</th>' for cell in head) + "</tr></thead>")
    lines.append("<tbody>")
    for first, *others in rows:
        cells = "".join(f"<td>{cell}</td>" for cell in others)
        lines.append(f'<tr><th scope="row">{first}</th>{cells}</tr>')
    return "\n".join([*lines, "</tbody></table></div>"])


def unfolding(summary: str, content: str) -> str:
    """Content behind a line to click on; it is printed unfolded."""
    return f"<details><summary>{summary}</summary>\n{content}\n</details>"


def preformatted(text: str) -> str:
    """Plain text as it is."""
    return f"<pre>{escape(text)}</pre>"
