"""The keys of lists of tables: zones, cases, combinations, motions, slip, losses, targets, stages."""

from netfall.job.cases import CASE, COMBINATION
from netfall.job.keys import ABSENT, REQUIRED, Key, between, choice, flag, not_negative, positive

LISTS: dict[str, tuple[Key, ...]] = {
    "zone": (
        Key("name", "name", REQUIRED, "", "name by which [wind.zone.NAME] and [load.zone.NAME] refer to it"),
        Key(
            "polygon",
            "polygon",
            ABSENT,
            "m",
            "corners in plan of the start geometry, in order around it",
            low=-1e9,
            high=1e9,
        ),
        Key("groups", "words", ABSENT, "", "groups of elements whose nodes belong to it"),
        flag(
            "cut",
            False,
            "whether a polygon takes of each node's area what lies inside; false: nodes inside whole",
        ),
    ),
    "case": CASE,
    "combination": COMBINATION,
    "motion": (
        Key("nodes", "integers", ABSENT, "", "ids of the supports that move; absent: all"),
        Key("displacement", "path", ABSENT, "m", "path of a table time, x, y, z, linear between its rows"),
        Key(
            "acceleration",
            "path",
            ABSENT,
            "m/s2",
            "path of a record (.AT2, in g) or of a table time, x, y, z or time, acceleration, likewise",
        ),
        Key("direction", "vector", ABSENT, "", "of an acceleration of one component", low=-1e9, high=1e9),
        between(-1e6, 1e6, "scale", "", 1.0, "by which it is multiplied"),
        positive("speed", "m/s", ABSENT, "of a wave that travels; absent: all at once", high=1e6),
        Key("travel", "vector", ABSENT, "", "direction in which it travels", low=-1e9, high=1e9),
        flag("baseline", True, "baseline correction of a record (.AT2)"),
    ),
    "slide": (
        Key("group", "text", ABSENT, "", "group whose cables may slip over nodes"),
        Key("cables", "words", ABSENT, "", "or the names of the pieces of cable that may"),
        Key(
            "nodes",
            "integers",
            ABSENT,
            "",
            "ids of the nodes over which they slip; absent: every node inside these cables",
        ),
        not_negative("friction", "", 0.0, "coefficient of friction of a saddle", high=10.0),
        not_negative("resistance", "N", 0.0, "resistance of a clamp to slip", high=1e12),
    ),
    "remove": (
        Key("elements", "integers", ABSENT, "", "ids of the elements that are lost"),
        Key("group", "text", ABSENT, "", "or the group of elements that is lost"),
        Key("cables", "words", ABSENT, "", "or the names of the pieces of cable that are lost"),
        not_negative(
            "time",
            "s",
            REQUIRED,
            "time in the dynamic stage at which the elements lose their stiffness",
            high=1e9,
        ),
        not_negative(
            "duration", "s", 0.0, "time over which their tension then falls to zero; 0: at once", high=1e9
        ),
    ),
    "target": (
        Key("group", "text", ABSENT, "", "group, or piece of cable, whose mean force is wanted"),
        between(-1e12, 1e12, "force", "N", ABSENT, "that force, tension positive"),
        Key(
            "node",
            "integer",
            ABSENT,
            "",
            "or the id of a node whose height is wanted",
            low=-(2**63),
            high=2**63 - 1,
        ),
        between(-1e6, 1e6, "height", "m", ABSENT, "z of that node"),
        Key(
            "by",
            "text",
            REQUIRED,
            "",
            "group, or piece of cable, whose unstressed lengths are changed, each cable by one amount",
        ),
    ),
    "stage": (
        Key("name", "name", REQUIRED, "", "name of the stage of erection"),
        Key(
            "lengths",
            "lengths",
            ABSENT,
            "",
            "unstressed lengths of groups or pieces of cable: changed, set, or pulled to a force",
        ),
        Key("active", "words", ABSENT, "", "groups that are there from now on; absent: as before"),
        Key("release", "integers", ABSENT, "", "ids of nodes that are no longer held"),
        Key("hold", "integers", ABSENT, "", "ids of nodes that are held from now on, where they are"),
        Key("move", "shifts", ABSENT, "m", "by how much held nodes are moved, from where they are, by ids"),
        choice(
            "clamps",
            ("open", "closed"),
            ABSENT,
            "clamps of [[slide]] from now on: open, without resistance, or closed; absent: as before",
        ),
        Key(
            "set",
            "loads",
            {},
            "",
            "what it sets from now on: dead, snow, pressure, temperature, as in a case",
        ),
    ),
}

LOST = ("elements", "group", "cables")  # keys of [[remove]] that say what is lost: one of them
