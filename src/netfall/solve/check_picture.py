"""The picture of `netfall check`: the net of a job as it is read, with what the job says of it."""

from pathlib import Path

import numpy as np

from netfall.job.read import Job
from netfall.net.areas import along_normals, normals, tributary_areas
from netfall.output.place import writing
from netfall.solve.model import Model
from netfall.wind.sectors import bearing


def draw_check(job: Job, model: Model, folder: Path) -> Path:
    """Write NAME_net.png into a folder, from the net before its form is found; the path of it."""
    from netfall.output.plot_job import JobNet, draw_job

    net, faces = model.net, model.roofing.faces
    zones, plan = model.zones, tributary_areas(net.x, net, faces).plan
    rows = lambda parts: np.unique(np.concatenate([np.zeros(0, np.int64), *parts]))
    shown = JobNet(
        job.title or job.name,
        net,
        faces,
        plan,
        zones.names,
        zones.of_node,
        np.array([(plan * zones.of_zone(k)).sum() for k in (*range(len(zones.names)), -1)]),
        [zone.polygon for zone in job.zones if zone.polygon is not None],
        normals(net.x, net, faces) if along_normals(job) else None,
        rows(model.lost),
        rows([model.probes.named]),
        rows([model.probes.particles]),
        _wind_of(job),
    )
    path = folder / f"{job.path.stem}_net.png"
    with writing(path):
        folder.mkdir(parents=True, exist_ok=True)
        draw_job(shown, path)
    return path


def _wind_of(job: Job) -> tuple[float, str] | None:
    """Where the wind of a job blows to [degrees], and what it is; None: there is none, or taps say all."""
    wind = job.wind
    if wind is None or wind.pressures is not None:
        return None
    what = f"wind of {wind.speed:g} m/s" if wind.speed else f"wind of {wind.file}"
    return wind.direction, f"{what} {bearing(wind.direction)}"
