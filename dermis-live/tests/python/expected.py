"""What each message should hold, by the time that it was measured; both scripts hold theirs against it."""

import json
import math
import struct


class Expected:
    def __init__(self, path):
        with open(path) as file:
            whole = json.load(file)
        self.frame_id = whole["frame_id"]
        self.picture = whole["picture"]
        self.fields = whole["fields"]
        self.frames = {frame["measured_ns"]: frame for frame in whole["frames"]}

    def of(self, header):
        """The frame that a message was made of."""
        assert header.frame_id == self.frame_id, header.frame_id
        return self.frames[header.stamp.sec * 1_000_000_000 + header.stamp.nanosec]

    def check_values(self, message):
        expected = self.of(message.header)
        assert (message.height, message.encoding, message.is_bigendian) == (1, "32FC1", 0)
        assert message.step == 4 * message.width
        same(floats(message.data), expected["values_ohm"])

    def check_image(self, message):
        expected = self.of(message.header)
        assert [message.height, message.width] == self.picture
        same(floats(message.data), expected["picture"])

    def check_contacts(self, message):
        expected = self.of(message.header)
        assert [field.name for field in message.fields] == self.fields
        assert [field.offset for field in message.fields] == [4 * i for i in range(len(self.fields))]
        assert message.point_step == 4 * len(self.fields)
        assert (message.height, message.width) == (1, len(expected["contacts"]))
        # 6 is uint32, 7 is float32.
        layout = "<" + "".join({6: "I", 7: "f"}[field.datatype] for field in message.fields)
        points = list(struct.iter_unpack(layout, bytes(message.data)))
        for point, contact in zip(points, expected["contacts"], strict=True):
            same(point, contact)

    def check_wrench(self, message):
        expected = self.of(message.header)
        force, torque = message.wrench.force, message.wrench.torque
        same([force.x, force.y, force.z, torque.x, torque.y, torque.z], expected["wrench"])


def floats(data):
    return [value for (value,) in struct.iter_unpack("<f", bytes(data))]


def same(found, expected):
    """Equal to the last digit of a 32-bit number; `null` stands for no number."""
    assert len(found) == len(expected), (len(found), len(expected))
    for a, b in zip(found, expected):
        assert math.isnan(a) if b is None else abs(a - b) <= 1.2e-7 * abs(b), (a, b)
