"""PyTorch: networks as modules, training samples as datasets, the forward model as a differentiable function.

>>> import dermis, torch
>>> from dermis.torch import forward
>>> skin = dermis.Skin.load("skin16")
>>> conductivity = torch.tensor(skin.rest_conductivity, requires_grad=True)
>>> frame = forward(skin, conductivity)          # (channels,), ohm
>>> frame.square().sum().backward()
>>> conductivity.grad.shape == conductivity.shape
True
"""

from dermis.torch._forward import ElectrodeMotion, forward
from dermis.torch._network import Network
from dermis.torch._samples import SampleDataset, SampleStream

__all__ = ["ElectrodeMotion", "Network", "SampleDataset", "SampleStream", "forward"]
