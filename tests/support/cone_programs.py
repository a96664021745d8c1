"""Random programs of `cone_program`, and their solution by Clarabel."""

import dataclasses

import clarabel
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from scipy.spatial.transform import Rotation

from colift.onboard.control import cone_program, constrained_allocation

RINGS = {3: (3, 1), 4: (2, 2), 6: (3, 2), 16: (4, 4)}  # agents and arms of each, by contacts
TOLERANCE, ITERATIONS = 2e-6, 5000  # programs with larger residuals are flagged
WEIGHTS = cone_program.Penalties()
GRAVITY = np.array([0.0, 0.0, -9.81])


@dataclasses.dataclass(frozen=True)
class Geometry:
    """Rows and weight of the deviation of one team."""

    A: np.ndarray
    P: np.ndarray
    agents: int
    normals: np.ndarray
    mass: float


@dataclasses.dataclass(frozen=True)
class Problem:
    """Data of one control period."""

    x_0: np.ndarray
    b: np.ndarray
    sets: cone_program.ConeSets
    n: np.ndarray


def ring(agents: int, arms: int) -> Geometry:
    """Agents on a circle of 0.8 m around a payload of 0.8 kg an agent."""
    angle = 2 * np.pi * np.arange(agents) / agents
    across = (np.arange(arms) - (arms - 1) / 2) * 0.7 / max(arms - 1, 1)
    out, side = (np.stack([f(angle), g(angle)], 1) for f, g in ((np.cos, np.sin), (lambda a: -np.sin(a), np.cos)))
    c = (0.8 * out[:, None] + across[None, :, None] * side[:, None]).reshape(-1, 2)
    c = np.column_stack([c, np.full(len(c), 0.05)])
    m_L, m = 0.8 * agents, 1.84
    J = m_L * np.diag([0.15, 0.15, 0.3])
    G = np.vstack([np.hstack([np.eye(3)] * len(c)), np.hstack([np.cross(p, np.eye(3)).T for p in c])])
    acceleration = np.vstack([G[:3] / m_L, np.linalg.solve(J, G[3:])])
    owner = np.repeat(np.arange(agents), arms)
    totals = [np.kron(owner == j, np.eye(3)) for j in range(agents)]
    slack = np.vstack([(m_L + agents * m) * acceleration[:3], J @ acceleration[3:] / 0.8])
    A = np.vstack([*(m * acceleration[:3] + total for total in totals), np.eye(3 * len(c)), slack])
    P = 0.1 * (np.eye(3 * len(c)) + 100 * sum(total[:2].T @ total[:2] for total in totals))
    normals = -c * [1, 1, 0] / np.linalg.norm(c[:, :2], axis=1, keepdims=True)
    return Geometry(A=A, P=P, agents=agents, normals=normals, mass=m_L + agents * m)


def draw(of: Geometry, rng: np.random.Generator) -> Problem:
    """A random demand and random limits; about half of the demands exceed the limits."""
    contacts = len(of.normals)
    size = rng.choice([0.5, 2.0, 5.0])
    R = Rotation.from_rotvec(rng.normal(size=3) * [0.15, 0.15, 2]).as_matrix()
    hover = 9.81 * of.mass / of.agents
    share = rng.uniform(0.9, 1.6, of.agents)
    x_0 = np.tile(R.T @ [0, 0, hover / (2 * contacts / of.agents)], contacts) + rng.normal(size=3 * contacts) * size
    b = np.concatenate([rng.normal(size=3 * of.agents) * size, np.zeros(3 * contacts), rng.normal(size=6) * size])
    b[: 3 * of.agents] += np.tile(R.T @ [0, 0, hover / 2], of.agents)
    b[-6:] -= of.A[-6:] @ x_0
    grips = rng.random() < 0.5
    blocks, far = of.agents, cone_program.UNLIMITED
    sets = cone_program.ConeSets(
        axis=jnp.asarray(np.vstack([np.tile(R[2], (blocks, 1)), of.normals])),
        tan=jnp.asarray(
            np.r_[
                np.full(blocks, np.tan(np.deg2rad(rng.uniform(10, 35)))),
                np.full(contacts, rng.uniform(0.4, 0.9) if grips else far),
            ]
        ),
        minimum=jnp.asarray(np.r_[np.full(blocks, 0.2 * hover), np.full(contacts, 0.5 if grips else -far)]),
        maximum=jnp.asarray(np.r_[hover * share, np.full(contacts, rng.uniform(8, 25))]),
    )
    return Problem(x_0=x_0, b=b, sets=sets, n=R[2])


solve = jax.jit(cone_program.solve)


def make_program(of: Geometry, tolerance: float = TOLERANCE, iterations: int = ITERATIONS) -> cone_program.ConeProgram:
    """Return the constant matrices with the step sizes of limited contacts."""
    steps = constrained_allocation.step_sizes(of.agents, len(of.normals), is_limited=True)
    program = cone_program.make_program(of.A, of.P, WEIGHTS, steps, iterations)
    return dataclasses.replace(program, tolerance=jnp.asarray(tolerance))


def cold_start(program: cone_program.ConeProgram) -> cone_program.WarmStart:
    """Return a start without a former solution."""
    zero = jnp.zeros(program.A.shape[0])
    return cone_program.WarmStart(projected=zero, multipliers=zero)


def solution(program: cone_program.ConeProgram, p: Problem) -> cone_program.Solution:
    """Solve a program from a cold start."""
    return solve(program, jnp.asarray(p.x_0), jnp.asarray(p.b), p.sets, jnp.asarray(p.n), cold_start(program))


def objective(of: Geometry, p: Problem, x: np.ndarray) -> float:
    """Value of the program."""
    v = of.A @ x + p.b
    blocks = v[:-6].reshape(-1, 3)
    outside = np.linalg.norm(blocks - np.asarray(cone_program.project(jnp.asarray(blocks), p.sets)), axis=1).sum()
    force, moment = v[-6:-3], v[-3:]
    parts = {"z": force @ p.n, "yaw": moment @ p.n}
    parts |= {"xy": np.linalg.norm(force - parts["z"] * p.n), "roll_pitch": np.linalg.norm(moment - parts["yaw"] * p.n)}
    slack = sum(float(getattr(WEIGHTS, name)) * abs(part) for name, part in parts.items())
    d = x - p.x_0
    return 0.5 * d @ of.P @ d + float(WEIGHTS.constraint) * outside + slack


def reference_solution(of: Geometry, p: Problem) -> np.ndarray:
    """Solve the program by the interior-point method of Clarabel."""
    unknowns, blocks = of.A.shape[1], len(p.sets.tan)
    size = unknowns + 4 + 4 * blocks  # x, bounds of four slacks, and distance vector with its bound of every block
    rows, offsets, cones = [], [], []

    def add(M: np.ndarray, c: np.ndarray, cone: type) -> None:
        rows.append(-M)
        offsets.append(c)
        cones.append(cone(len(c)))

    def wide(M: np.ndarray) -> np.ndarray:
        return np.hstack([M, np.zeros((len(M), size - M.shape[1]))])

    quadratic, linear = clarabel.SecondOrderConeT, clarabel.NonnegativeConeT
    for i in range(blocks):
        M, c, first = wide(of.A[3 * i : 3 * i + 3]), p.b[3 * i : 3 * i + 3], unknowns + 4 + 4 * i
        M[:, first : first + 3] -= np.eye(3)
        axis, tan, least, most = (np.asarray(x)[i] for x in (p.sets.axis, p.sets.tan, p.sets.minimum, p.sets.maximum))
        across = np.eye(3) - np.outer(axis, axis)
        add(np.vstack([0 * M[:1], M]), np.r_[most, c], quadratic)
        if tan < cone_program.UNLIMITED:
            add(np.vstack([tan * axis @ M, across @ M]), np.r_[tan * axis @ c, across @ c], quadratic)
        if least > -cone_program.UNLIMITED:
            add((axis @ M)[None], np.array([axis @ c - least]), linear)
        distance = np.zeros((4, size))
        distance[0, first + 3], distance[1:, first : first + 3] = 1, np.eye(3)
        add(distance, np.zeros(4), quadratic)
    E, e, along = of.A[-6:], p.b[-6:], np.outer(p.n, p.n)
    across = np.eye(3) - along
    for level, (side, block) in enumerate(((across, 3), (along, 0), (across, 0), (along, 3))):
        top = np.zeros((1, size))
        top[0, unknowns + level] = 1
        add(np.vstack([top, wide(side @ E[block : block + 3])]), np.r_[0, side @ e[block : block + 3]], quadratic)
    Q, q = np.zeros((size, size)), np.zeros(size)
    Q[:unknowns, :unknowns], q[:unknowns] = of.P, -of.P @ p.x_0
    q[unknowns : unknowns + 4] = [float(getattr(WEIGHTS, name)) for name in ("roll_pitch", "z", "xy", "yaw")]
    q[unknowns + 7 :: 4] = float(WEIGHTS.constraint)
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-9
    solver = clarabel.DefaultSolver(
        sp.csc_matrix(np.triu(Q)), q, sp.csc_matrix(np.vstack(rows)), np.concatenate(offsets), cones, settings
    )
    return np.array(solver.solve().x)[:unknowns]
