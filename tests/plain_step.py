"""The dynamic stage, particle by particle, from the equations of docs/pages/explanation/model.md.

It shares no line with the program and has none of its data structures. test_manufactured.py compares both.
"""

from dataclasses import dataclass, field

import numpy as np

GRAVITY = 9.81


@dataclass
class Plain:
    """A net of particles (n, 3) and elements (m, 2), with the loads of one job.

    x, v : [m], [m/s] half a step behind; free : (n, 3) bool; mass : (n,) [kg]; load : (n, 3) [N], constant
    growing : (n, 3) [N], in full after `ramp` [s]; wind : (n, 3) [N] at 1 m/s; spring : (n, 3) [N/m]
    speed : (t, 2) times [s] and speeds [m/s]
    ends, L0, EA, limit, eps_u, half, bar : of the elements; half : [kg], half of their own mass
    zeta : [1/s]; stable_dt : [s], for which the mass of fragments is sufficient
    after : effect of a fracture on the wind, as after_fracture; weighs : whether elements have weight
    fragments : whether a particle splits at a fracture; otherwise the element is removed
    drag : (n,) [kg/m] rho A / 2, of detached parts with after = "detached", checked every 0.01 s
    """

    x: np.ndarray
    free: np.ndarray
    mass: np.ndarray
    load: np.ndarray
    growing: np.ndarray
    ramp: float
    wind: np.ndarray
    speed: np.ndarray
    spring: np.ndarray
    ends: np.ndarray
    L0: np.ndarray
    EA: np.ndarray
    limit: np.ndarray
    eps_u: np.ndarray
    half: np.ndarray
    bar: np.ndarray
    zeta: float
    stable_dt: float
    after: str = "particle"
    weighs: bool = True
    fragments: bool = True
    drag: np.ndarray = None
    v: np.ndarray = None
    events: list = field(default_factory=list)

    def __post_init__(self):
        self.v, self.start = np.zeros_like(self.x), self.x.copy()
        self.eps_p, self.heat = np.zeros(len(self.ends)), np.zeros(len(self.ends))
        self.work = np.zeros(3)  # J, of external, internal and damping forces
        self.broken = np.zeros(len(self.ends), bool)
        self.id, self.loose = list(range(len(self.x))), np.zeros(len(self.x), bool)
        self.n = len(self.x)

    def strains(self):
        d = self.x[self.ends[:, 1]] - self.x[self.ends[:, 0]]
        L = np.sqrt((d**2).sum(1))
        return L / self.L0 - 1.0, d / L[:, None]

    def axial(self, eps):
        """Compute axial forces and new plastic strains."""
        N = self.EA * (eps - self.eps_p)
        lowest = np.where(self.bar, -self.limit, 0.0)
        held = np.clip(N, lowest, self.limit)
        yields = (N > self.limit) | (self.bar & (N < -self.limit))
        return held, np.where(yields, self.eps_p + (N - held) / np.maximum(self.EA, 1.0), self.eps_p)

    def cut_free(self):
        """Remove the wind from particles that unbroken elements connect to no vertical support."""
        reached = set(np.flatnonzero(~self.free[:, 2] | (self.spring[:, 2] > 0.0)).tolist())
        pairs = self.ends[~self.broken].tolist()
        while more := {p for pair in pairs for p in pair if reached & set(pair)} - reached:
            reached |= more
        self.loose = np.array([p not in reached for p in range(len(self.x))])
        self.wind[self.loose] = 0.0

    def forces(self, time, dt):
        """Compute external and internal forces in an update of dt, and strains. Elements yield here."""
        eps, direction = self.strains()
        N, eps_p = self.axial(eps)
        flow = np.abs(eps_p - self.eps_p)
        self.heat += np.where(flow > 0.0, self.limit, 0.0) * self.L0 * flow  # what never yields has no limit
        self.eps_p = eps_p
        internal = self.spring * (self.start - self.x)
        for e, (a, b) in enumerate(self.ends):
            internal[a] += N[e] * direction[e]
            internal[b] -= N[e] * direction[e]
        speed = np.interp(time, *self.speed.T)
        external = self.load + min(1.0, time / self.ramp) * self.growing + speed**2 * self.wind
        for p in np.flatnonzero(self.loose[: self.n]):  # what splits off has no surface
            w = np.array([speed, 0.0, 0.0]) - self.v[p]
            k = self.drag[p] * np.linalg.norm(w)
            external[p] += k / (1.0 + k * dt / self.mass[p]) * w
        return external, internal, eps

    def kick(self, dt, external, internal):
        """Return the velocities after an update of dt."""
        h = 0.5 * self.zeta * dt
        new = ((1 - h) * self.v + dt * (external + internal) / self.mass[:, None]) / (1 + h)
        return np.where(self.free, new, 0.0)

    def run(self, dt, steps):
        """Advance by a number of steps; the first velocity update is a half one."""
        self.dt, self.slack = dt, []
        for n in range(steps):
            if n % 10 == 0:
                self.note_slack()
            length = 0.5 * dt if n == 0 else dt
            if self.after == "detached" and int(n * dt / 0.01 + 1e-9) > int((n - 1) * dt / 0.01 + 1e-9):
                self.cut_free()
            external, internal, eps = self.forces(n * dt, length)
            new = self.kick(length, external, internal)
            mean = 0.5 * (self.v + new)
            forces = external, internal, self.zeta * self.mass[:, None] * mean
            self.work += [length * (mean * force).sum() for force in forces]
            self.v = new
            self.x = self.x + dt * new
            over, remnants = eps > self.eps_u, self.broken.copy()
            self.split(np.flatnonzero(over & ~remnants), n, external + internal)
            self.lengthen(np.flatnonzero(over & remnants))

        self.note_slack()

    def note_slack(self):
        """Record cables that are unbroken and slack."""
        self.slack.append((self.axial(self.strains()[0])[0] == 0.0) & ~self.bar & ~self.broken)

    def split(self, elements, n, force):
        """Break elements at x(n+1), each at the end with the larger force."""
        valence = np.bincount(self.ends.ravel(), minlength=len(self.x))
        for e in elements:
            size = np.linalg.norm(force[self.ends[e]], axis=1)
            end = int(size[1] > size[0])
            p, number = self.ends[e, end], self.n + 2 * e + end
            assert abs(size[0] - size[1]) > 1e-6 * size.max() and valence[p] > 1
            if not self.fragments:
                self.take_out(e, p, n)
                continue
            mass = max(self.half[e], 0.5 * self.EA[e] / self.L0[e] * self.stable_dt**2)
            self.broken[e] = True
            if self.limit[e] > self.EA[e] * self.eps_u[e] and not self.bar[e]:
                self.limit[e] = np.inf  # it grows longer instead
            elif self.limit[e] < np.inf:
                self.eps_u[e] = np.inf  # it yields instead
            weight = GRAVITY * mass if self.weighs else 0.0
            self.mass[p] -= mass
            self.load[p, 2] += weight
            self.wind[p if self.after in ("particle", "detached") else slice(None)] *= self.after == "none"
            self.ends[e, end] = len(self.x)
            row = lambda array, value: np.concatenate([array, [value]])
            self.x, self.v, self.start = (row(a, a[p]) for a in (self.x, self.v, self.start))
            self.free, self.mass = row(self.free, [True] * 3), row(self.mass, mass)
            self.load = row(self.load, [0, 0, -weight])
            self.growing, self.wind, self.spring = (
                row(a, np.zeros(3)) for a in (self.growing, self.wind, self.spring)
            )
            self.id.append(number)
            self.loose = row(self.loose, True)
            self.events.append((n, e, p if p < self.n else self.id[p], number, mass))

    def lengthen(self, elements):
        """Lengthen remainders to just above their strain at fracture; their other energy is heat."""
        for e in elements:
            a, b = self.ends[e]
            d, v = self.x[b] - self.x[a], self.v[b] - self.v[a]
            L, before, worked = np.linalg.norm(d), self.L0[e], np.linalg.norm(d - 0.5 * self.dt * v)
            self.L0[e] = max(before, L / (1.0 + self.eps_u[e] * (1.0 + 1e-9)))
            strains = [(max(0.0, worked / L0 - 1.0 - self.eps_p[e]), L0) for L0 in (before, self.L0[e])]
            stored = [0.5 * self.EA[e] * eps**2 * L0 for eps, L0 in strains]
            self.heat[e] += stored[0] - stored[1]

    def take_out(self, e, p, n):
        """Remove element e, broken at p: its mass stays, its energy half a position update ago is heat."""
        a, b = self.ends[e]
        L = np.linalg.norm(self.x[b] - self.x[a] - 0.5 * self.dt * (self.v[b] - self.v[a]))
        trial = self.EA[e] * (L / self.L0[e] - 1.0 - self.eps_p[e])
        N = min(trial, self.limit[e])
        self.heat[e] += N**2 / self.EA[e] * self.L0[e] / 2 + N * self.L0[e] * (trial - N) / self.EA[e]
        self.broken[e], self.eps_u[e], self.EA[e], self.limit[e] = True, np.inf, 0.0, 0.0
        self.events.append((n, e, p, -1, 0.0))

    def energies(self, dt, time):
        """Return kinetic, strain, dissipated, damping and external energy [J] at x(n), amid the update."""
        heat, eps_p = self.heat.copy(), self.eps_p.copy()
        external, internal, eps = self.forces(time, dt)
        N, new = self.axial(eps)
        stored = 0.5 * (N**2 / np.maximum(self.EA, 1.0) * self.L0).sum()
        stored += 0.5 * (self.spring * (self.x - self.start) ** 2).sum()
        lost = self.heat.sum()
        self.heat, self.eps_p = heat, eps_p
        new = self.kick(dt, external, internal)
        self.velocity = v = 0.5 * (self.v + new)
        way = 0.5 * dt * 0.5 * (self.v + v)
        work = self.work[0] + (way * external).sum()
        damping = self.work[2] + (way * self.zeta * self.mass[:, None] * 0.5 * (self.v + new)).sum()
        kinetic = 0.5 * (self.mass[:, None] * v**2).sum()
        return dict(kinetic=kinetic, strain=stored, plastic=lost, external=work, damping=damping)
