"""Reads a recording with rosbags and holds every message against what was recorded: check_recording.py FILE EXPECTED"""

import json
import sys
from collections import Counter
from pathlib import Path

from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from expected import Expected


def check_definitions(connections):
    """The definitions in the file are those of ROS 2 itself: their hashes (REP 2016) are the same."""
    for distribution in (Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY):
        official = get_typestore(distribution)
        embedded = get_typestore(Stores.EMPTY)
        for connection in connections:
            embedded.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        for connection in connections:
            name = connection.msgtype
            assert embedded.hash_rihs01(name) == official.hash_rihs01(name), (distribution, name)
    return embedded


def main(path, expected):
    expected = Expected(expected)
    counts = Counter()
    with Reader(Path(path)) as reader:
        store = check_definitions(reader.connections)
        for connection, time, data in reader.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            counts[connection.topic] += 1
            match connection.topic:
                case "/dermis/frame":
                    expected.check_values(message)
                    assert expected.of(message.header)["measured_ns"] == time
                case "/dermis/image":
                    expected.check_image(message)
                case "/dermis/contacts":
                    expected.check_contacts(message)
                case "/dermis/wrench":
                    expected.check_wrench(message)
                case "/dermis/wire":
                    assert bytes(message.data).hex() == expected.frames[time]["message"]
                case "/dermis/markers":
                    contacts = expected.of(message.markers[0].header)["contacts"]
                    assert len(message.markers) == (2 * len(contacts) or 1)
                    assert [marker.action for marker in message.markers] == ([0] * (2 * len(contacts)) or [3])
                    assert contacts == [] or message.markers[0].points[1].x == expected.of(message.markers[0].header)["at_m"][0]
                case "/diagnostics":
                    names = [status.name for status in message.status]
                    assert names == ["dermis: instrument", "dermis: electrodes", "dermis: frequency"]
                    assert message.status[1].message == "all sound"
                case "/dermis/events":
                    assert json.loads(message.data) == {"kind": "command", "value": {"tare": None}}
    frames = len(expected.frames)
    for topic in ("frame", "image", "contacts", "wrench", "wire"):
        assert counts[f"/dermis/{topic}"] == frames, counts
    assert counts["/dermis/events"] == 1 and counts["/diagnostics"] >= 2 and counts["/dermis/markers"] > 0, counts
    print(f"rosbags: {sum(counts.values())} messages on {len(counts)} topics are what was recorded")


main(*sys.argv[1:])
