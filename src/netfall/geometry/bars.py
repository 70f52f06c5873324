"""Properties of compressed bars in addition to an area: second moment, buckling length and curve; Euler load.

N_cr = pi^2 E I / L_k^2. [cable] gives them for all bars, [group.NAME] for the bars of a group.
"""

from collections.abc import Iterator

import numpy as np

from netfall.core.arrays import BoolArray, IntArray
from netfall.geometry import messages
from netfall.geometry.net import Net
from netfall.geometry.sections import values_of_key
from netfall.job import messages as job_messages
from netfall.job.job import Job
from netfall.job.keys.groups import group_values, section_of_key
from netfall.job.keys.schema import CURVES
from netfall.job.values import counted

OF_BARS = ("second_moment", "buckling_length")
BAR_FLAGS = ("bending", "buckling")
MODULUS_ROUNDING = 1e-6  # relative excess of a section modulus due to rounded digits
MAX_SECOND_MOMENT_RATIO = 1e5  # largest plausible I / A^2; tubes have up to 10, trusses as one bar some 1000
# smallest plausible buckling length over the length of the bar; 0.5 if both ends are clamped
MIN_BUCKLING_SHARE = 0.45
IN_CHECKS = ("section_modulus", "design_strength")  # that only the report reads
CONCRETE_DENSITY = 2000.0, 2600.0  # kg/m3, of normal-weight concrete: EN 206, 3.1.1
CONCRETE_MODULUS = 60e9  # Pa, above that of every concrete of EN 1992-1-1, Table 3.1, and below aluminium's
BAR_KEYS = (*OF_BARS, "buckling_curve", *BAR_FLAGS, *IN_CHECKS)


def set_bars(job: Job, net: Net) -> None:
    """Set second moments and buckling properties of the bars of a net, if any bar has one."""
    moment, length = (np.where(net.bar, values_of_key(job, net, name, np.nan), np.nan) for name in OF_BARS)
    if np.isfinite(moment).any():
        net.second_moment, net.buckling_length = moment, length
        curve = values_of_key(job, net, "buckling_curve")
        net.buckling_curve = np.argmax(curve[:, None] == np.array(CURVES), axis=1)
    for name in BAR_FLAGS:
        flags = values_of_key(job, net, name) & net.bar
        if flags.any():
            setattr(net, name, flags)


def buckling_lengths(net: Net, L0: np.ndarray) -> np.ndarray:
    """Return the buckling lengths (m,) [m]: as given, otherwise the length of the element of the table.

    L0 : (m,) [m], unstressed; the length of an element of the table is the sum over its parts
    """
    if net.buckling_length is None:
        raise ValueError("the net has no bars that buckle")
    return np.where(np.isnan(net.buckling_length), _length_in_table(net, L0), net.buckling_length)


def _length_in_table(net: Net, length: np.ndarray) -> np.ndarray:
    """Return the length (m,) of the element of the table that each element is a part of; length : (m,)"""
    return np.repeat(length.reshape(-1, net.parts).sum(1), net.parts)


def euler_load(net: Net, L0: np.ndarray) -> np.ndarray:
    """Compute the Euler load (m,) [N] of bars of unstressed lengths L0 (m,) [m]; nan: no second moment."""
    if net.second_moment is None:
        return np.full(net.m, np.nan)
    with np.errstate(divide="ignore"):  # zero length: form finding collapsed, and `check_tensions` reports it
        return np.pi**2 * net.modulus * net.second_moment / buckling_lengths(net, L0) ** 2


def resembles_concrete(modulus: np.ndarray, density: np.ndarray) -> np.ndarray:
    """Select the elements (m,) with a modulus [Pa] and a density [kg/m3] of concrete."""
    low, high = CONCRETE_DENSITY
    return np.asarray((modulus < CONCRETE_MODULUS) & (low <= density) & (density <= high))


def bar_errors(job: Job, net: Net) -> Iterator[str]:
    """Yield errors: keys of bars in groups of cables, unknown moduli, bars that cannot bend or buckle."""
    absent = np.zeros(net.m, bool)

    def first_id(rows: BoolArray) -> IntArray:
        return net.element_id[np.flatnonzero(rows)[:1]]

    for g, name in enumerate(net.group_names):
        if not net.bar[net.group == g].any():
            given = group_values(job.groups, name)
            for key in (key for key in BAR_KEYS if key in given):
                section = section_of_key(job.groups, name, key)
                yield messages.KEY_OF_BARS(name=section, key=key, value=given[key])
    moment = np.full(net.m, np.nan) if net.second_moment is None else net.second_moment
    for e in np.flatnonzero(np.isfinite(moment) & net.nominal)[:1]:
        yield messages.MOMENT_WITHOUT_MODULUS(element=net.element_id[e], value=moment[e])
    bending, buckling = (absent if flags is None else flags for flags in (net.bending, net.buckling))
    for name, flags in (("bending", bending), ("buckling", buckling)):
        for e in first_id(flags & np.isnan(moment)):
            yield messages.NO_SECOND_MOMENT(element=e, key=name)
    for g, name in enumerate(net.group_names):
        table, rows = job.group_properties(name), net.bar & (net.group == g)
        if (W := table.section_modulus) is None or not rows.any():
            continue
        largest = np.sqrt(moment * net.section)
        for e in first_id(rows & np.isnan(moment)):
            yield messages.NO_SECOND_MOMENT(element=e, key="section_modulus")
        for e in np.flatnonzero(rows & (W > largest * (1.0 + MODULUS_ROUNDING)))[:1]:
            yield job_messages.LARGE_SECTION_MODULUS(element=net.element_id[e], value=W, largest=largest[e])
        for e in first_id(rows & np.isinf(net.yield_stress) & (table.design_strength is None)):
            yield job_messages.NO_DESIGN_STRENGTH(element=e, value=W)
    for e in first_id(bending & buckling):
        yield messages.BENDING_AND_BUCKLING(element=e)
    bent = {net.group_names[g] for g in np.unique(net.group[bending])}
    missing = [stage.name for stage in job.stages if stage.active is not None and bent - set(stage.active)]
    if bent and missing:
        yield messages.BENDING_BARS_NOT_ACTIVE(stages=", ".join(missing))
    if bent and job.targets:
        yield messages.TARGETS_WITH_BENDING()
    if bent and net.length_error.any():
        yield messages.LENGTH_ERRORS_WITH_BENDING()
    for e in first_id(bending & np.isfinite(net.fracture_strain) & (job.dynamics is not None)):
        yield messages.BREAKABLE_BENDING(element=e)


def bar_notes(job: Job, net: Net) -> Iterator[str]:
    """Yield notes on keys without effect and on possible concrete, and warnings of implausible values."""
    if net.second_moment is None:
        keys = job.given() & {f"cable.{key}" for key in BAR_KEYS}
        for name, group in job.groups.items():
            keys |= {f"group.{name}.{key}" for key in BAR_KEYS if key in group.given()}
        yield from (messages.BAR_KEY_WITHOUT_MOMENT(key=key) for key in sorted(keys))
        return
    concrete = resembles_concrete(net.modulus, net.density) & net.bar
    for g, name in enumerate(net.group_names):
        place, table = f"[group.{name}]" if name else "[cable]", job.group_properties(name)
        if table.design_strength is not None and table.section_modulus is None:
            yield job_messages.UNUSED_DESIGN_STRENGTH(place=place)
        if table.section_modulus is not None and concrete[net.group == g].any():
            yield job_messages.CHECK_OF_CONCRETE(place=place)
    length = _length_in_table(net, net.lengths())
    given = np.full(net.m, np.nan) if net.buckling_length is None else net.buckling_length
    short = np.flatnonzero(given < MIN_BUCKLING_SHARE * length)
    for e in short[:1]:
        elements = counted("element", net.element_id[short])
        yield job_messages.SHORT_BUCKLING_LENGTH(value=given[e], elements=elements, length=length[e])
    stout = np.flatnonzero(net.second_moment > MAX_SECOND_MOMENT_RATIO * net.section**2)
    for e in stout[:1]:
        value, area = net.second_moment[e], net.section[e]
        elements, radius = counted("element", net.element_id[stout]), np.sqrt(value / area)
        yield messages.LARGE_SECOND_MOMENT(value=value, elements=elements, area=area, radius=radius)
