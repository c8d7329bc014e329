"""Receives a robot with Cyclone DDS and sends it joint states: check_robot.py DOMAIN SECONDS

The robot is that of `dermis new robot`, with simulated devices, in the namespace /arm.
"""

import json
import math
import sys
import time

import numpy as np
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from messages import (
    LATCHED,
    RELIABLE,
    SENSOR,
    WATCHED,
    DiagnosticArray,
    Header,
    JointState,
    PointCloud2,
    Text,
    Time,
    TransformArray,
    WrenchStamped,
)


def main(domain, seconds):
    participant = DomainParticipant(int(domain))

    def reader(name, kind, qos=WATCHED):
        return DataReader(participant, Topic(participant, f"rt{name}", kind), qos=qos)

    joints = DataWriter(participant, Topic(participant, "rt/joint_states", JointState), qos=RELIABLE)
    readers = {
        "contacts": reader("/arm/dermis/contacts", PointCloud2),
        "zones": reader("/arm/dermis/zones", Text),
        "events": reader("/arm/dermis/events", Text, RELIABLE),
        "wrench": reader("/arm/dermis/wrench/hand_link", WrenchStamped),
        "of a skin": reader("/arm/dermis/palm/contacts", PointCloud2),
        "diagnostics": reader("/diagnostics", DiagnosticArray, RELIABLE),
        "frames": reader("/tf_static", TransformArray, LATCHED),
    }
    seen = {name: [] for name in readers}
    touched = []

    def diagnosed():
        return {status.name for message in seen["diagnostics"] for status in message.status}

    def is_enough():
        has_contact = any(cloud.width for cloud in seen["contacts"])
        return all(seen.values()) and touched and has_contact and {"dermis: palm", "dermis: forearm"} <= diagnosed()

    end = time.monotonic() + float(seconds)
    while time.monotonic() < end and not is_enough():
        now = time.time()
        stamp = Time(int(now), int(1e9 * math.modf(now)[0]))
        positions = [0.3, 0.5, 0.0]
        joints.write(JointState(Header(stamp, ""), ["shoulder", "elbow", "wrist"], positions, [], []))
        for name, source in readers.items():
            seen[name] += source.take(N=100)
        touched = [text for text in seen["zones"] if json.loads(text.data)["touched"]]
        time.sleep(0.005)
    print(f"Cyclone DDS received {({name: len(messages) for name, messages in seen.items()})}")
    assert is_enough(), f"not all messages within {seconds} s"

    cloud = next(cloud for cloud in reversed(seen["contacts"]) if cloud.width)
    assert cloud.header.frame_id == "base_link", cloud.header
    kinds = {6: "<u4", 7: "<f4"}
    fields = [(field.name, kinds[field.datatype]) for field in cloud.fields]
    assert fields[-1] == ("skin", "<u4") and len(fields) * 4 == cloud.point_step, fields
    points = np.frombuffer(bytes(cloud.data), dtype=np.dtype(fields))
    assert len(points) == cloud.width and set(points["skin"]) <= {0, 1}, points
    # The arm reaches 0.2 + 0.35 + 0.36 m and a skin's length up.
    reach = np.sqrt(points["x"] ** 2 + points["y"] ** 2 + points["z"] ** 2)
    assert ((reach > 0.3) & (reach < 1.1)).all(), reach
    assert np.allclose(points["nx"] ** 2 + points["ny"] ** 2 + points["nz"] ** 2, 1, atol=1e-5), points

    frames = {frame.child_frame_id: frame.header.frame_id for frame in seen["frames"][0].transforms}
    assert frames == {"forearm": "forearm_link", "palm": "hand_link"}, frames
    assert seen["of a skin"][0].header.frame_id == "palm"
    assert seen["wrench"][0].header.frame_id == "hand_link"
    assert "dermis palm: electrodes" in diagnosed(), diagnosed()
    zones = json.loads(touched[-1].data)
    assert {skin["skin"] for skin in zones["skins"]} == {"forearm", "palm"}, zones
    assert json.loads(seen["events"][0].data)["event"] in ("begins", "changes", "ends")


main(*sys.argv[1:])
