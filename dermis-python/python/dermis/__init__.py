"""Electrical resistance tomography (ERT) skins for robots: from a design to contacts.

>>> import dermis
>>> skin = dermis.Skin.load("cylinder30")
>>> untouched = skin.forward()                                   # (870,), ohm
>>> touched = skin.touched_conductivity([0.0, 0.05, 0.15])       # (cells,), S
>>> contacts = skin.method("spots").contacts(skin.forward(touched), untouched)
>>> contacts.position_m.round(2)
array([[0.  , 0.05, 0.15]])
"""

from dermis._command import command
from dermis._contacts import Contacts
from dermis._dermis import (
    Calibration,
    Dataset,
    Frame,
    Live,
    Mesh,
    Method,
    Paired,
    Pipeline,
    Replay,
    Robot,
    RobotLive,
    Samples,
    Simulation,
    Skin,
    Solution,
    Twin,
    __version__,
    finish_dataset,
)
from dermis._errors import DermisError

__all__ = [
    "Calibration",
    "Contacts",
    "Dataset",
    "DermisError",
    "Frame",
    "Live",
    "Mesh",
    "Method",
    "Paired",
    "Pipeline",
    "Replay",
    "Robot",
    "RobotLive",
    "Samples",
    "Simulation",
    "Skin",
    "Solution",
    "Twin",
    "__version__",
    "command",
    "finish_dataset",
]
