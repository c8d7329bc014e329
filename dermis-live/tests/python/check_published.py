"""Receives what is published with Cyclone DDS: check_published.py DOMAIN NAMESPACE EXPECTED SECONDS STOP

Makes the file STOP when it has received enough: then the publisher must stop, and the middleware must tell so.
"""

import pathlib
import sys
import time
from dataclasses import dataclass

from cyclonedds.core import Listener, Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint8, uint32
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from expected import Expected


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Image(IdlStruct, typename="sensor_msgs::msg::dds_::Image_"):
    header: Header
    height: uint32
    width: uint32
    encoding: str
    is_bigendian: uint8
    step: uint32
    data: sequence[uint8]


@dataclass
class PointField(IdlStruct, typename="sensor_msgs::msg::dds_::PointField_"):
    name: str
    offset: uint32
    datatype: uint8
    count: uint32


@dataclass
class PointCloud2(IdlStruct, typename="sensor_msgs::msg::dds_::PointCloud2_"):
    header: Header
    height: uint32
    width: uint32
    fields: sequence[PointField]
    is_bigendian: bool
    point_step: uint32
    row_step: uint32
    data: sequence[uint8]
    is_dense: bool


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Wrench(IdlStruct, typename="geometry_msgs::msg::dds_::Wrench_"):
    force: Vector3
    torque: Vector3


@dataclass
class WrenchStamped(IdlStruct, typename="geometry_msgs::msg::dds_::WrenchStamped_"):
    header: Header
    wrench: Wrench


@dataclass
class KeyValue(IdlStruct, typename="diagnostic_msgs::msg::dds_::KeyValue_"):
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticStatus_"):
    level: uint8
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticArray_"):
    header: Header
    status: sequence[DiagnosticStatus]


# What rclcpp::SensorDataQoS asks for, and what the diagnostic tools ask for.
SENSOR = Qos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, Policy.History.KeepLast(5))
INTERVAL = duration(milliseconds=250)
WATCHED = Qos(
    *SENSOR, Policy.Deadline(INTERVAL), Policy.Liveliness.ManualByTopic(lease_duration=INTERVAL)
)
RELIABLE = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.Durability.Volatile, Policy.History.KeepLast(10))


class Watch(Listener):
    """Counts the publishers that are alive, and the deadlines that were missed."""

    def __init__(self):
        super().__init__()
        self.alive = 0
        self.missed = 0

    def on_liveliness_changed(self, reader, status):
        self.alive = status.alive_count

    def on_requested_deadline_missed(self, reader, status):
        self.missed = status.total_count


def main(domain, namespace, expected, seconds, stop):
    expected = Expected(expected)
    participant = DomainParticipant(int(domain))

    def reader(name, kind, qos=SENSOR, listener=None):
        return DataReader(participant, Topic(participant, f"rt{name}", kind), qos=qos, listener=listener)

    def check_diagnostics(message):
        assert [status.name for status in message.status] == [
            "dermis: instrument",
            "dermis: electrodes",
            "dermis: frequency",
        ]

    watch = Watch()

    readers = {
        "frame": (reader(f"{namespace}/dermis/frame", Image), expected.check_values),
        "image": (reader(f"{namespace}/dermis/image", Image), expected.check_image),
        "contacts": (reader(f"{namespace}/dermis/contacts", PointCloud2), expected.check_contacts),
        "wrench": (reader(f"{namespace}/dermis/wrench", WrenchStamped, WATCHED, watch), expected.check_wrench),
        "diagnostics": (reader("/diagnostics", DiagnosticArray, RELIABLE), check_diagnostics),
    }
    counts = dict.fromkeys(readers, 0)
    wanted = {"diagnostics": 1}
    end = time.monotonic() + float(seconds)
    while time.monotonic() < end and any(counts[name] < wanted.get(name, 100) for name in readers):
        for name, (source, check) in readers.items():
            for message in source.take(N=10):
                check(message)
                counts[name] += 1
        time.sleep(0.005)
    print(f"Cyclone DDS received {counts}")
    assert all(counts[name] >= wanted.get(name, 100) for name in readers), f"too few within {seconds} s: {counts}"
    assert watch.alive == 1, "the publisher is alive"
    pathlib.Path(stop).touch()
    begin = time.monotonic()
    while time.monotonic() < end and (watch.alive > 0 or watch.missed == 0):
        time.sleep(0.005)
    print(f"told {time.monotonic() - begin:.2f} s later that the publisher has stopped")
    assert watch.alive == 0 and watch.missed > 0, f"alive {watch.alive}, missed deadlines {watch.missed}"


main(*sys.argv[1:])
