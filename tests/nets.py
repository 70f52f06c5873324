"""Nets of the tests: jobs and tables as text, models, sums of forces, equilibria by a direct solver."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from netfall.core.timings import PhaseTimes
from netfall.driver.setup import prepare_problem
from netfall.model.layout import make_layout
from netfall.model.model import make_model
from netfall.parallel.mpi import MPI

BREAKS = "yield_stress = 1.75e9\nfracture_strain = 0.0404\n"
STORM = """[wind]
onset = "sudden"
speed = 60.0
pressure_coefficient = -3.0
base_height = 10.0
surface_drag = 0.03
gust_field = "point"
seed = 3
"""
WEAK = "yield_stress = 1e9\nfracture_strain = 0.015\n[form_finding]\n[load]\nself_weight = false\n"
CABLE = 1.95e11, 400e-6, 7850.0  # modulus [Pa], area [m2], density [kg/m3]


def bare_saddle(cells=6, prestress=100e3, side=40.0, rise=3.66, section=CABLE, parts: int = 1) -> str:
    """Return the text of a job of the generated saddle, which ends in [cable]."""
    modulus, area, density = section
    subdivide = f"subdivide = {parts}\n" if parts > 1 else ""
    return f"""[net]
generator = "saddle"
{subdivide}[net.saddle]
side = {side}
rise = {rise}
cells = {cells}
[cable]
modulus = {modulus}
area = {area}
density = {density}
prestress = {prestress}
"""


def saddle(more: str = BREAKS, cells=6, parts: int = 1, prestress=100e3, **size) -> str:
    """Return the text of a job of a saddle with a form at constant tension. more : keys of [cable]"""
    form = "[form_finding]\nmodulus_factor = 0\n"
    return bare_saddle(cells, prestress, parts=parts, **size) + more + form


LOW_SADDLE = bare_saddle(4, 1e5, rise=2.0, section=(1e11, 5e-4, 7850.0))


def model_of(job):
    """Return the model of a job in its start geometry, on one rank."""
    layout = make_layout(job, 1)
    return make_model(job, layout, layout.net.x, None)


def problem_of(job):
    """Return the problem of a run of a job, on one rank."""
    return prepare_problem(MPI.COMM_SELF, job, PhaseTimes())[0]


def word(value) -> str:
    """Return a cell of a table; numbers have all digits."""
    return str(value.item() if isinstance(value, np.generic) else value)


def table(header: str, rows) -> str:
    """Return a table as text."""
    return "\n".join([header, *(",".join(map(word, row)) for row in rows)]) + "\n"


def stage(name: str, **keys) -> str:
    """Return the text of a stage."""
    return f'[[stage]]\nname = "{name}"\n' + "".join(f"{key} = {value}\n" for key, value in keys.items())


MAST = '[group.mast]\nkind = "bar"\narea = 6e-3\nprestress = -50e3\n'


def mast_and_ring() -> tuple[str, str]:
    """Return tables of six stays from a mast to a ring cable that six outer cables hold."""
    nodes, elements = [(1, 0, 0, 0, 1), (2, 0.5, 0.2, 6, 0)], [(1, 2, "mast")]
    for k in range(6):
        c, s = np.cos(np.pi * k / 3), np.sin(np.pi * k / 3)
        nodes += [(10 + k, 5 * c, 5 * s, 2, 0), (20 + k, 10 * c, 10 * s, 0, 1)]
        elements += [(2, 10 + k, ""), (10 + k, 10 + (k + 1) % 6, ""), (10 + k, 20 + k, "")]
    return table("id,x,y,z,fixed", nodes), table("start,end,group", elements)


def dense(matrix) -> np.ndarray:
    """Return all rows of `multigrid.rows.BlockRows` (3 rows, 3 columns), on every rank."""
    whole = np.zeros((matrix.rows.n, 3, matrix.columns.n, 3))
    whole[matrix.pattern.row, :, matrix.pattern.column] = matrix.block
    return matrix.comm.allreduce(whole).reshape(3 * matrix.rows.n, -1)


def along(x, elements) -> tuple[np.ndarray, np.ndarray]:
    """Return directions (m, 3) and lengths (m,) of elements (m, 2) between points (n, 3)."""
    d = x[elements[:, 1]] - x[elements[:, 0]]
    L = np.linalg.norm(d, axis=1)
    return d / L[:, None], L


def pulls(x, elements, N) -> np.ndarray:
    """Return the sum (n, 3) [N] of the elements' forces (m,) at each node."""
    force, total = N[:, None] * along(x, elements)[0], np.zeros_like(x)
    np.add.at(total, elements[:, 0], force)
    np.subtract.at(total, elements[:, 1], force)
    return total


def elastic(L0, EA, most=np.inf):
    """Return the law of an elastic cable that yields at `most` [N]: tension and stiffness at lengths L."""

    def law(L):
        N = np.clip(EA * (L - L0) / L0, 0.0, most)
        return N, np.where((N > 0.0) & (N < most), EA / L0, 0.0)

    return law


def constant(T):
    """Return the law of a cable under constant tension T [N]."""
    return lambda L: (np.full_like(L, T), np.zeros_like(L))


def stiffness_of(x, elements, N, axial) -> coo_array:
    """Return the tangent (3 n, 3 n), with a negligible stiffness on axes without one."""
    e, L = along(x, elements)
    little = 1e-9 * axial.max()
    block = (axial - N / L)[:, None, None] * e[:, :, None] * e[:, None, :]
    block += (N / L + little)[:, None, None] * np.eye(3)
    rows, columns, values = [], [], []
    for a, b, sign in ((0, 0, 1), (1, 1, 1), (0, 1, -1), (1, 0, -1)):
        i = 3 * elements[:, a, None, None] + np.arange(3)[None, :, None]
        j = 3 * elements[:, b, None, None] + np.arange(3)[None, None, :]
        rows.append(np.broadcast_to(i, block.shape).ravel())
        columns.append(np.broadcast_to(j, block.shape).ravel())
        values.append(sign * block.ravel())
    place = np.concatenate(rows), np.concatenate(columns)
    return coo_array((np.concatenate(values), place), shape=(x.size, x.size)).tocsr()


def equilibrium(x, elements, law, fixed, load, tolerance=1e-5) -> tuple[np.ndarray, np.ndarray]:
    """Find positions and tensions with N, dN/dL = law(L) by Newton's method with the exact tangent.

    fixed : (n, 3); load : (n, 3) [N]; tolerance : of the largest force that is left [N]
    """
    x, free = x.copy(), np.flatnonzero(~fixed.ravel())
    for _ in range(60):
        N, axial = law(along(x, elements)[1])
        residual = (load + pulls(x, elements, N)).ravel()[free]
        if np.abs(residual).max() < tolerance:
            return x, N
        K = stiffness_of(x, elements, N, axial)
        x.ravel()[free] += spsolve(K[free][:, free].tocsc(), residual)
    raise AssertionError("Newton did not converge")
