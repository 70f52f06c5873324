"""The keys of [wind], a part of the table in `schema`."""

from netfall.job.keys import ABSENT, Key, between, count, not_negative, positive

WIND: tuple[Key, ...] = (
    between(0.1, 200.0, "speed", "m/s", ABSENT, "U0, mean at 10 m above ground"),
    Key("file", "path", ABSENT, "", "path of a table time, speed, instead of a generated wind"),
    Key(
        "points",
        "path",
        ABSENT,
        "",
        "path of a table name, x, y, z: where the speeds of file were measured, a column each by name",
    ),
    Key(
        "pressures", "path", ABSENT, "N/m2", "path of a table of pressures in time at taps, instead of a wind"
    ),
    Key("taps", "path", ABSENT, "", "path of a table name, x, y: where the taps of pressures are"),
    between(
        -360.0,
        360.0,
        "direction",
        "degrees",
        0.0,
        "where it blows to, from x towards y: 30 is a wind from 210",
    ),
    Key("roughness", "number", 0.03, "", "k of the gusts; 0: no gusts", low=0.0, high=0.2),
    Key(
        "turbulence",
        "number",
        ABSENT,
        "",
        "intensity at 10 m, instead of roughness: k = I^2 / 6; 0: no gusts",
        low=0.0,
        high=1.0,
    ),
    Key(
        "spectrum",
        "choice",
        "davenport",
        "",
        "of the gusts",
        choices=("davenport", "kaimal", "von_karman", "en1991"),
    ),
    Key(
        "gust_length",
        "number",
        "auto",
        "m",
        "L of the spectrum; auto: 1200, 56.7, 63.2 and 63.2, in the order of the choices, at 10 m",
        low=0.1,
        high=1e5,
        also=("auto",),
    ),
    Key(
        "shape_coefficient",
        "number",
        ABSENT,
        "",
        "u_s: positive presses on the roof, against the upward normal; negative is suction, which lifts",
        low=-1e4,
        high=1e4,
    ),
    Key(
        "sectors",
        "path",
        ABSENT,
        "",
        "path of a table direction, shape_coefficient and columns named as zones are, instead of "
        "shape_coefficient",
    ),
    positive("air_density", "kg/m3", 1.25, "density of the air", high=1e4),
    between(1e-4, 60.0, "time_step", "s", 0.05, "time step of the generated histories"),
    count("ar_order", 14, "largest number of lags of the autoregressive model", high=30),
    count("seed", 1, "number that the random histories are a function of", low=0, high=2**63 - 1),
    count("control_points", 25, "largest number of points at which histories are generated", low=1, high=400),
    Key(
        "coherence_decay",
        "vector",
        (8.0, 16.0, 10.0),
        "",
        "C of Davenport's coherence along the wind, across, vertical",
        low=0.0,
        high=1e6,
    ),
    not_negative("profile_exponent", "", 0.16, "of the mean speed over height", high=1.0),
    between(-1e6, 1e6, "base_height", "m", 10.0, "height of z = 0 above ground"),
    Key(
        "onset",
        "choice",
        "static",
        "",
        "static: the roof rests under its loads and the mean wind, then the gusts grow in; "
        "sudden: all of the wind at t = 0",
        choices=("static", "sudden"),
    ),
    not_negative(
        "ramp", "s", 2.0, "time over which the gusts grow in after a static onset; 0: at once", high=1e9
    ),
    Key(
        "after_fracture",
        "choice",
        "particle",
        "",
        "what loses the wind at a fracture",
        choices=("particle", "panels", "all", "none"),
    ),
)
