"""One self-contained page about one run or many.

    from suspend.report import write_report
    write_report(["runs/demo"], "report.html")
"""

from __future__ import annotations

from suspend.report.write import write_report

__all__ = ["write_report"]
