"""Import of a vehicle from an MJCF file: bodies, joints and inertias as MuJoCo compiles them.

The base is the body with a free joint; without one, it is the only body of the world. Hinges and slides are read;
contacts, tendons, actuators and sensors are not. Position zero of a joint is the pose of the file.

MuJoCo is an optional dependency.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np
from scipy.spatial.transform import Rotation

from colift.models.link_tree import CONTINUOUS, FIXED, PRISMATIC, REVOLUTE, Coupling, Link, LinkJoint, LinkTree
from colift.models.robot import UNLIMITED_JOINT, Body, JointLimits
from colift.runtime import bounded_read

INCLUDING_ELEMENTS = ("include", "model")  # elements that read other files
MAX_MESH_BYTES = 2**28  # largest file of a mesh or height field
MAX_NUMBER = 1e12  # largest number, so that products do not overflow
UNLIMITED = 63.0  # rad or m, larger limits of position mean that there is none


def read_mjcf(path: str | Path) -> LinkTree:
    """Read the bodies and joints of an MJCF file.

    A file that cannot be read, is too large or is not a regular file raises `OSError`, also an included file or a mesh.

    Meshes without influence on the inertia are omitted, so that their files are not required.

    Args:
        path: File.

    Returns:
        Links and joints; sites are links without mass.

    Raises:
        ValueError: If MuJoCo is not installed or does not accept the file, or if the file has no vehicle, joints that
            are not supported, or numbers that are not finite.
    """
    try:
        import mujoco
    except ImportError:
        raise ValueError("an MJCF file requires MuJoCo: pip install 'colift[mujoco]'") from None
    _check_included_files(Path(path))
    try:
        with _without_warnings(mujoco):
            spec = mujoco.MjSpec.from_file(str(path))
            _without_display(spec, mujoco)
            _check_mesh_files(spec)
            spec.compiler.fusestatic = False  # `reduce_tree` merges bodies that are fixed to others
            stated = [_Stated(body) for body in spec.bodies if body.explicitinertial]
            model, balanced = _compile(spec)
    except (ValueError, RuntimeError) as error:
        raise ValueError(f"{path}: MuJoCo: {' '.join(str(error).split())}") from None
    changed = {each.body.id: each for each in stated if balanced and each.violates()}
    tree = _Reader(str(path), model, mujoco, changed).tree()
    _check_numbers(tree)
    return tree


def _compile(spec: Any) -> tuple[Any, bool]:
    """Compile a model, and return whether inertias were balanced, as a stated inertia may require."""
    try:
        return spec.compile(), False
    except ValueError as error:
        if "balanceinertia" not in str(error):
            raise
    spec.compiler.balanceinertia = True  # `reduce_tree` checks the stated inertias
    return spec.compile(), True


@contextlib.contextmanager
def _without_warnings(mujoco: Any) -> Generator[None]:
    """Discard the warnings of MuJoCo, which it would also append to a file in the current folder."""
    previous = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _message: None)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        mujoco.set_mju_user_warning(previous)


def _check_numbers(tree: LinkTree) -> None:
    """Raise ValueError if a number of the vehicle is not finite or too large, which MuJoCo accepts."""
    for link in tree.links.values():
        body = link.inertial
        if body is not None and not _is_usable(body.mass, body.com, body.inertia):
            raise ValueError(f"{tree.file}: body {link.name!r} has a mass or inertia that is not finite or too large")
    for joint in tree.joints.values():
        if not _is_usable(joint.rotation, joint.position, joint.axis, *_stated(joint)):
            raise ValueError(f"{tree.file}: {joint.name!r} has a pose, axis or limit that is not finite or too large")


def _stated(joint: LinkJoint) -> Iterator[object]:
    """Yield the limits and the coupling of a joint."""
    yield from (each for each in (joint.limits.position, joint.limits.speed, joint.limits.effort) if each is not None)
    if joint.coupling is not None:
        yield joint.coupling.multiplier, joint.coupling.offset


def _is_usable(*values: object) -> bool:
    """Return whether all numbers are finite and not too large."""
    return all((np.abs(np.asarray(value, float)) <= MAX_NUMBER).all() for value in values)


def _check_included_files(path: Path) -> None:
    """Raise OSError if the file, or one that it includes, cannot be read, is too large, or is not a regular file.

    MuJoCo opens the files itself, without a limit on their size, and blocks at a pipe.
    """
    pending, known = [path], {path}
    while pending:
        file = pending.pop()
        content = bounded_read.read_bytes(file, bounded_read.MAX_TEXT_BYTES)
        for name in _included_names(content):
            # the path may be relative to the file that includes it, or to the first file
            found = {folder / name for folder in (path.parent, file.parent)} - known
            known |= found
            pending += [included for included in found if included.exists()]


def _included_names(content: bytes) -> list[str]:
    """Return the names of the files that a document includes; those before an error, if it is not XML."""
    parser, names = expat.ParserCreate(), []

    def begin(tag: str, attributes: dict[str, str]) -> None:
        if tag in INCLUDING_ELEMENTS and "file" in attributes:
            names.append(attributes["file"])

    parser.StartElementHandler = begin
    with contextlib.suppress(expat.ExpatError):  # MuJoCo reports the error
        parser.Parse(content, True)
    return names


def _check_mesh_files(spec: Any) -> None:
    """Raise OSError if a mesh or height field cannot be read, is too large, or is not a regular file."""
    folder = Path(spec.modelfiledir)
    for asset in (*spec.meshes, *spec.hfields):
        path = folder / (spec.meshdir or "") / asset.file
        if asset.file and path.exists():  # MuJoCo reports a missing file
            bounded_read.read_bytes(path, MAX_MESH_BYTES)


def _without_display(spec: Any, mujoco: Any) -> None:
    """Remove meshes and materials that do not influence the inertia."""
    kept = False
    for geom in list(spec.geoms):
        if geom.type == mujoco.mjtGeom.mjGEOM_MESH and (geom.parent.explicitinertial or geom.mass == 0):
            spec.delete(geom)
        else:
            geom.material = ""
            kept |= geom.type == mujoco.mjtGeom.mjGEOM_MESH
    for site in spec.sites:
        site.material = ""
    for group in (spec.materials, spec.textures, *(() if kept else (spec.meshes,))):
        for asset in list(group):
            spec.delete(asset)


class _Stated:
    """Mass and inertia of a body as the file states them, before MuJoCo compiles them."""

    def __init__(self, body: Any):
        self.body, self.mass = body, float(body.mass)
        moments, full = np.array(body.inertia), np.array(body.fullinertia)
        self.full = np.array([full[[0, 3, 4]], full[[3, 1, 5]], full[[4, 5, 2]]]) if np.isfinite(full).all() else None
        self.moments = moments if self.full is None else np.linalg.eigvalsh(self.full)

    def violates(self) -> bool:
        """Return whether the moments violate the triangle inequality, so that MuJoCo replaces them by their mean."""
        a, b, c = np.sort(self.moments)
        return bool(a > 0 and c > a + b)

    def inertia(self, R: np.ndarray) -> np.ndarray | None:
        """Return the inertia [kg m^2, frame of the body]; None if MuJoCo has changed this frame.

        Args:
            R: Rotation of the compiled inertial frame.
        """
        if self.full is None:
            return R @ np.diag(self.moments) @ R.T
        principal = R.T @ self.full @ R
        rest = principal - np.diag(np.diag(principal))
        return self.full if np.abs(rest).max() < 1e-9 * np.abs(principal).max() else None


class _Reader:
    """Conversion of a compiled model."""

    def __init__(self, file: str, model: Any, mujoco: Any, stated: dict[int, _Stated]):
        self.file, self.model, self.types, self.stated = file, model, mujoco.mjtJoint, stated
        self.equality_types = mujoco.mjtEq
        self.shift: dict[int, np.ndarray] = {}  # link origin in the frame of each body [m]

    def tree(self) -> LinkTree:
        """Convert the vehicle of the model."""
        model, root = self.model, self._root()
        links: dict[str, Link] = {}
        joints: dict[str, LinkJoint] = {}
        couplings = dict(self._couplings())
        for body in self._below(root):
            name = self._name(body)
            joint = None if body == root else self._joint(body)
            self.shift[body] = np.zeros(3) if joint is None else np.array(model.jnt_pos[joint])
            links[name] = Link(name=name, location=self.file, inertial=self._inertial(body))
            if body != root:
                link_joint = self._link_joint(body, joint, couplings)
                joints[link_joint.name] = link_joint
            for site in np.flatnonzero(model.site_bodyid == body):
                self._add_site(int(site), name, body, links, joints)
        damped = tuple(
            self._joint_name(j)
            for j in range(model.njnt)
            if self._joint_name(j) in joints
            and (model.dof_damping[self._dof(j)] or model.dof_frictionloss[self._dof(j)])
        )
        notes = tuple(self._notes(joints))
        return LinkTree(file=self.file, root=self._name(root), links=links, joints=joints, damped=damped, notes=notes)

    def _notes(self, joints: dict[str, LinkJoint]) -> Iterator[str]:
        """Yield sentences on properties of joints that the model does not have."""
        model = self.model
        own = [j for j in range(model.njnt) if self._joint_name(j) in joints]
        for property_, values in (
            ("armature (add it to the inertia of the body)", {j: model.dof_armature[self._dof(j)] for j in own}),
            ("stiffness", {j: model.jnt_stiffness[j] for j in own}),
        ):
            names = [self._joint_name(j) for j, value in values.items() if np.any(value)]
            if names:
                yield f"{property_} is not read: {', '.join(names)}"

    def _root(self) -> int:
        """Return the base of the vehicle."""
        model = self.model
        free = [int(model.jnt_bodyid[j]) for j in range(model.njnt) if self._type(j) == self.types.mjJNT_FREE]
        tops = [b for b in range(1, model.nbody) if model.body_parentid[b] == 0]
        found = free or tops
        if len(found) != 1 or model.body_parentid[found[0]] != 0:
            names = ", ".join(map(self._name, found)) or "none"
            raise ValueError(
                f"{self.file}: one vehicle is required: a body of the world with a free joint; found: {names}: "
                f"{'remove the others from a copy of the file' if found else 'add one'}"
            )
        return found[0]

    def _below(self, root: int) -> Iterator[int]:
        """Iterate over the bodies of the vehicle; MuJoCo numbers parents before children."""
        reached = {root}
        for body in range(1, self.model.nbody):
            if body == root or int(self.model.body_parentid[body]) in reached:
                reached.add(body)
                yield body

    def _type(self, joint: int) -> Any:
        """Return the type of a joint."""
        return self.types(int(self.model.jnt_type[joint]))

    def _name(self, body: int) -> str:
        """Return the name of a body, or its number."""
        return self.model.body(body).name or f"body_{body}"

    def _joint_name(self, joint: int) -> str:
        """Return the name of a joint, or that of its body."""
        return self.model.joint(joint).name or f"{self._name(int(self.model.jnt_bodyid[joint]))}_joint"

    def _dof(self, joint: int) -> int:
        """Return the first degree of freedom of a joint."""
        return int(self.model.jnt_dofadr[joint])

    def _joint(self, body: int) -> int | None:
        """Return the joint of a body; None if it is fixed to its parent."""
        first, count = int(self.model.body_jntadr[body]), int(self.model.body_jntnum[body])
        if count > 1:
            raise ValueError(f"{self.file}: body {self._name(body)!r} has {count} joints; one joint is supported")
        if count and self._type(first) not in (self.types.mjJNT_HINGE, self.types.mjJNT_SLIDE):
            raise ValueError(f"{self.file}: body {self._name(body)!r} has a joint that is neither a hinge nor a slide")
        return first if count else None

    def _inertial(self, body: int) -> Body | None:
        """Return mass and inertia of a body in the frame of its link."""
        model = self.model
        R = _matrix(model.body_iquat[body])
        moments, mass = model.body_inertia[body], float(model.body_mass[body])
        J = R @ np.diag(moments) @ R.T
        if body in self.stated:
            stated = self.stated[body].inertia(R) if mass == self.stated[body].mass else None
            if stated is None:
                raise ValueError(
                    f"{self.file}: body {self._name(body)!r}: the principal moments violate the triangle inequality, "
                    "and options of the compiler change the body: state moments that satisfy it"
                )
            J = stated
        return Body(mass=mass, com=model.body_ipos[body] - self.shift[body], inertia=J) if mass > 0 else None

    def _link_joint(self, body: int, joint: int | None, couplings: dict[int, Coupling]) -> LinkJoint:
        """Return the joint between a body and its parent."""
        model, parent = self.model, int(self.model.body_parentid[body])
        R = _matrix(model.body_quat[body])
        kind, axis, limits = FIXED, np.array([1.0, 0.0, 0.0]), UNLIMITED_JOINT
        if joint is not None:
            slides = self._type(joint) == self.types.mjJNT_SLIDE
            limits = self._limits(joint)
            kind = PRISMATIC if slides else REVOLUTE if model.jnt_limited[joint] else CONTINUOUS
            axis = np.array(model.jnt_axis[joint])
        return LinkJoint(
            name=f"{self._name(body)}_fixed" if joint is None else self._joint_name(joint),
            kind=kind,
            parent=self._name(parent),
            child=self._name(body),
            rotation=R,
            position=model.body_pos[body] + R @ self.shift[body] - self.shift[parent],
            axis=axis,
            limits=limits,
            coupling=None if joint is None else couplings.get(joint),
            location=self.file,
        )

    def _limits(self, joint: int) -> JointLimits:
        """Return the limits of a joint; positions relative to the pose of the file."""
        model, position, effort = self.model, None, None
        if model.jnt_limited[joint]:
            reference = float(model.qpos0[model.jnt_qposadr[joint]])
            lower, upper = (float(x) - reference for x in model.jnt_range[joint])
            position = (lower, upper) if max(abs(lower), abs(upper)) <= UNLIMITED else None
        if model.jnt_actfrclimited[joint]:
            effort = float(np.abs(model.jnt_actfrcrange[joint]).max()) or None
        return JointLimits(position=position, effort=effort)

    def _couplings(self) -> Iterator[tuple[int, Coupling]]:
        """Yield joints that follow another one, by joint; other equality constraints close loops."""
        model = self.model
        for k in range(model.neq):
            name = model.equality(k).name or f"equality {k}"
            if self.equality_types(int(model.eq_type[k])) != self.equality_types.mjEQ_JOINT:
                raise ValueError(f"{self.file}: equality constraint {name!r} closes a loop, which is not supported")
            follower, followed = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
            offset, multiplier, *higher = model.eq_data[k][:5]
            if followed < 0 or any(higher):
                raise ValueError(f"{self.file}: equality constraint {name!r} is not linear in another joint")
            yield (
                follower,
                Coupling(
                    joint=self._joint_name(followed),
                    multiplier=float(multiplier),
                    offset=float(offset),
                    location=self.file,
                ),
            )

    def _add_site(
        self, site: int, parent: str, body: int, links: dict[str, Link], joints: dict[str, LinkJoint]
    ) -> None:
        """Add a site as a link without mass."""
        name = self.model.site(site).name
        if not name or name in links:
            return
        links[name] = Link(name=name, location=self.file, inertial=None)
        joints[f"{name}_site"] = LinkJoint(
            name=f"{name}_site",
            kind=FIXED,
            parent=parent,
            child=name,
            rotation=_matrix(self.model.site_quat[site]),
            position=self.model.site_pos[site] - self.shift[body],
            axis=np.array([1.0, 0.0, 0.0]),
            limits=UNLIMITED_JOINT,
            coupling=None,
            location=self.file,
        )


def _matrix(quaternion: np.ndarray) -> np.ndarray:
    """Convert a quaternion, scalar first, to a rotation matrix."""
    return Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
