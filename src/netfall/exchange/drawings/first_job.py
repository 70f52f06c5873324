"""The first job for a net that was imported: what runs at once, with what is to be decided marked."""

from netfall.job.toml_text import toml_name, toml_value

TEXT = """\
# {name}: a first job for the net that was imported. Sections and forces are placeholders: CHOOSE them.
#
#   netfall check this file
#   netfall run this file

title = {title}

[net]
nodes = "nodes.csv"
elements = "elements.csv"

[cable]                         # CHOOSE; the values of all groups that have none of their own below
modulus = 1.6e11                # Pa
area = 500e-6                   # m2
density = 7850.0                # kg/m3
prestress = 50e3                # N, with which the form is found
# yield_stress = 1.4e9          # Pa
# fracture_strain = 0.03
# catalogue = "cables.csv"      # name, mass_per_length, axial_stiffness, breaking_load; then for the cables
# type = "FLC40"                # of a group, in place of modulus, area and density

{groups}
[form_finding]                  # finds the form under the prestress; remove it to keep the geometry as drawn

[load]
self_weight = true
# dead = 300.0                  # N/m2 of roof surface, cladding
# snow = 750.0                  # N/m2 in plan
steps = 1

# [wind]
# speed = 40.0                  # m/s, mean at 10 m
# turbulence = 0.2
# shape_coefficient = -1.3      # suction
#
# [dynamics]
# duration = 6.0                # s
"""
GROUP = """\
# [cable.{name}]
# area = 500e-6                 # m2
# kind = "bar"                  # if it carries compression too
"""
POSTS = """\
[cable.{name}]
kind = "bar"                    # GUESSED: its elements are upright; remove it if they are cables
# area = 4000e-6                # m2
# modulus = 2.1e11
"""


def first_job(name: str, groups: list[str], posts: list[str]) -> str:
    """The text of the job for a drawing's name and its groups; posts : those taken to be bars."""
    parts = [(POSTS if group in posts else GROUP).format(name=toml_name(group)) for group in groups]
    title = toml_value(" ".join(name.split()) or "imported net")
    return TEXT.format(name=name, title=title, groups="".join(parts))
