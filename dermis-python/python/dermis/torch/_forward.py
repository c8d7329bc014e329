"""The forward model as a differentiable function."""

import numpy as np
import torch
from torch import Tensor, nn

from dermis._dermis import Skin
from dermis._errors import DermisError


class _Forward(torch.autograd.Function):
    @staticmethod
    def forward(ctx, skin, conductivity, contact_impedance, nodes):
        array = lambda tensor: None if tensor is None else tensor.detach().double().cpu().numpy()
        contacts, moved = array(contact_impedance), array(nodes)
        if not any(ctx.needs_input_grad):
            if contacts is None and moved is None:
                frames = skin.forward(array(conductivity))
            else:
                frames = skin.solve(array(conductivity), contact_impedance=contacts, nodes=moved).frames
        else:
            ctx.solution = skin.solve(array(conductivity), contact_impedance=contacts, nodes=moved)
            frames = ctx.solution.frames
        ctx.like = [conductivity, contact_impedance, nodes]
        return torch.tensor(frames, dtype=conductivity.dtype, device=conductivity.device)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, by_frame):
        parameters = any(ctx.needs_input_grad[2:])
        gradient = ctx.solution.gradient(by_frame.double().cpu().numpy(), parameters=parameters)
        results = [None]
        for name, needed, like in zip(
            ("conductivity", "contact_impedance", "nodes"), ctx.needs_input_grad[1:], ctx.like
        ):
            values = torch.from_numpy(gradient[name]).to(like) if needed else None
            results.append(values)
        return tuple(results)


def forward(
    skin: Skin, conductivity: Tensor, contact_impedance: Tensor | None = None, nodes: Tensor | None = None
) -> Tensor:
    """Frames of conductivities, differentiable in reverse mode by an exact adjoint: no Jacobian is computed.

    The gradient is that of the frames as the instrument reports them (amplitudes if it loses the signs). It can be
    differentiated once. The computation is in double precision on the CPU.

    Args:
        skin: A `dermis.Skin`.
        conductivity: (cells,) or (n, cells): S on surfaces, S/m in volumes.
        contact_impedance: (electrodes,): ohm m2 on areas, ohm m on edges; that of the design without it.
        nodes: Positions of the nodes, (nodes, 3), m; those of the mesh without it. `ElectrodeMotion` moves electrodes.

    Returns:
        (channels,) or (n, channels), ohm, of the type and on the device of `conductivity`.

    Raises:
        DermisError: A wrong shape or type, a value that is not positive and finite, nodes that turn a cell over.
    """
    if not conductivity.is_floating_point():
        raise DermisError(f"`conductivity` is of {conductivity.dtype}", hint="give float32 or float64")
    return _Forward.apply(skin, conductivity, contact_impedance, nodes)


class ElectrodeMotion(nn.Module):
    """Nodes of a mesh whose electrodes are displaced along the surface.

    The nodes of an electrode move with it. The displacement of the others falls linearly to zero at five radii of the
    electrode, or halfway to the next electrode. On a cylinder nodes stay at their radius; on a plane, in it; on other
    bodies displacements along the surface must be given.

    Args:
        skin: A `dermis.Skin` of triangles.
    """

    _RADII = 5.0
    nodes: Tensor
    weights: Tensor
    _along: Tensor
    is_cylinder: bool

    def __init__(self, skin: Skin) -> None:
        super().__init__()
        mesh, centres = skin.mesh, skin.electrodes
        nodes = mesh.nodes
        if mesh.cells.shape[1] != 3:
            raise DermisError("electrodes are moved on surfaces", hint="give a design whose mesh is of triangles")
        distance = np.linalg.norm(nodes[:, None] - centres, axis=2)
        between = np.linalg.norm(centres[:, None] - centres, axis=2)
        np.fill_diagonal(between, np.inf)
        weights = np.zeros(distance.shape)
        for electrode, own in enumerate(mesh.electrode_nodes):
            radius = max(distance[own, electrode].max(), 1e-4)
            end = min(self._RADII * radius, between[electrode].min() / 2)
            fall = (end - distance[:, electrode]) / max(end - radius, 1e-9)
            weights[:, electrode] = np.clip(fall, 0.0, 1.0)
            weights[own, electrode] = 1.0
        radii = np.hypot(nodes[:, 0], nodes[:, 1])
        self.is_cylinder = bool(np.ptp(radii) < 1e-9 * radii.max() and np.ptp(nodes[:, 2]) > 0)
        # On a plane nodes stay in it.
        self.register_buffer("_along", torch.tensor([1.0, 1.0, 0.0 if np.ptp(nodes[:, 2]) == 0 else 1.0]).double())
        self.register_buffer("nodes", torch.tensor(nodes))
        self.register_buffer("weights", torch.tensor(weights))

    def forward(self, displacement: Tensor) -> Tensor:
        """Positions of the nodes, (nodes, 3), m.

        Args:
            displacement: Of each electrode, (electrodes, 3), m.
        """
        moved = self.nodes + self.weights @ (displacement * self._along)
        if not self.is_cylinder:
            return moved
        radius = torch.linalg.vector_norm(self.nodes[:, :2], dim=1, keepdim=True)
        return torch.cat(
            [moved[:, :2] * radius / torch.linalg.vector_norm(moved[:, :2], dim=1, keepdim=True), moved[:, 2:]], dim=1
        )
