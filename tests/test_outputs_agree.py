"""One quantity is the same in each output: tables, summary, messages, pictures."""

from results import rows_of

# A cable of three elements carries 60 kN at two nodes; the middle one has the least tension and strength.
NODES = "id,x,y,z,fixed,load_z\n10,0,0,0,1,0\n20,5,0,-1,0,-60e3\n30,10,0,-1,0,-60e3\n40,15,0,0,1,0\n"
WEAK = "id,start,end,cable,breaking_load\n7,10,20,M,900e3\n8,20,30,M,800e3\n9,30,40,M,900e3\n"
CABLE = "[cable]\naxial_stiffness = 80e6\nmass_per_length = 4.0\n"


def test_the_largest_tension_of_a_cable_is_that_of_its_elements(workshop):
    """The element with the largest utilisation need not be the one with the largest tension."""
    workshop.solve(CABLE + "[load]\nself_weight = false\nsteps = 1\n", NODES, WEAK).close()
    folder = workshop.report().folder
    (cable,), elements = rows_of(folder / "cables.csv"), rows_of(folder / "elements.csv")
    top = max(elements, key=lambda row: float(row["tension_max"]))
    assert cable["element_max"] == top["element"] != "8"
    assert cable["tension_max"] == top["tension_max"] != cable["tension_en1993"]
    assert cable["breaking_load"] == "800000"
