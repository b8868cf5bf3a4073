"""What a sweep will do: its points with predicted time and memory, and how good predictions were so far."""

from __future__ import annotations

from suspend.sweep.cluster_section import ClusterSection
from suspend.sweep.machine import cores, free_memory
from suspend.sweep.points import check_points
from suspend.sweep.prediction import check_memory, make_tasks, pace, wall_time
from suspend.sweep.run import Call


def overview(call: Call, workers: int | None = None, section: ClusterSection | None = None) -> list[str]:
    """Lines of `--dry-run`, on this machine or by jobs of a section; raises what a call would before it starts."""
    check_points(call.left)
    tasks = sorted(make_tasks(call.points, call.places), key=lambda task: -task.seconds)
    memory = section.memory if section else call.sweep.memory or free_memory()
    left = {point.key for point in call.left}
    to_do = [task for task in tasks if task.point.key in left]
    check_memory(to_do, memory)
    workers = section.workers if section else workers or call.sweep.workers or cores()
    width = max(len(task.folder.name) for task in tasks)
    numbers = {point.key: number for number, point in enumerate(call.points, 1)}
    lines = [f"{'':>5} {'point'.ljust(width)}  {'predicted':>10} {'measured':>10} {'memory':>9}  state"]
    for task in tasks:
        failed = task.record.failures > call.sweep.retries
        going = f"at strain {task.record.strain:.4g}" if task.record.strain else "to do"
        state = "complete" if task.point.key not in left else "failed" if failed else going
        measured = f"{task.record.seconds:.0f} s" if task.record.seconds else ""
        figures = f"{task.seconds:8.0f} s {measured:>10} {task.memory / 1e6:6.0f} MB"
        lines.append(f"{numbers[task.point.key]:>5} {task.folder.name.ljust(width)}  {figures}  {state}")
    factor = pace([task for task in tasks if task.point.key not in left])
    remaining = [task.remaining * (factor or 1.0) for task in to_do]
    resources = f"{workers} core(s)" + (f" of {section.kind} jobs" if section else "") + f", {memory / 1e9:.3g} GB"
    lines.append(f"{len(tasks)} points, {call.done} complete; longest first on {resources}")
    if factor is not None:
        lines.append(f"complete points took {factor:.2g} times what was predicted (median): used for what is left")
    if to_do:
        wall = wall_time(remaining, workers) / 3600
        lines.append(f"left: about {sum(remaining) / 3600:.3g} h of computing, {wall:.3g} h of wall time")
    return lines
