"""Columns of /history: name, unit and meaning. This table needs no MPI, so readers of results use it too."""

from typing import NamedTuple

from netfall.core.text import table_rows


class Column(NamedTuple):
    """Description of a column; needs : a feature of `physics.fields.Features`, "" always"""

    name: str
    unit: str
    needs: str
    meaning: str


# The cells of a row: name; unit; needs; meaning.
COLUMNS = tuple(
    Column(*cells)
    for cells in table_rows("""
time | s | | time in the dynamic stage
time_step | s | | time step before the row
kinetic_energy | J | | kinetic energy of all particles
strain_energy | J | | change of the strain energy since the start of the stage
plastic_dissipation | J | | plastic dissipation; also the energy that was stored in removed elements, and in
    broken ones with `fragments = false`
damping_work | J | | work dissipated by `[dynamics] mass_damping`
air_work | J | air | work dissipated by `[wind] aerodynamic_damping`
band_damping_work | J | band | work against the Maxwell branches of `axial_damping_ratio`: their dissipation
    and the small energy that they store
slip_dissipation | J | sliding | heat of clamps and saddles over which cables slip, [[slide]]
support_work | J | motion | work of moving supports, [[motion]], and of the ground to which damping refers
external_work | J | | work of the external loads
attached_energy | J | | kinetic energy and total strain energy, prestress included, of the parts that unbroken
    elements connect to a support
work_identity_error | | | error of the work identity, as a share of the largest energy until then; in the
    first 50 steps of a motion up to 50 steps later
energy_balance_error | | | error of the energy balance (positive: gain), as a share of that energy
balance_error_attached | | | the same error as a share of the largest `attached_energy` until then
slack | | | number of slack cable elements
broken | | | number of broken elements, by rows
""")
)
