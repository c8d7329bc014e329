"""Receives what is published with Cyclone DDS: check_published.py DOMAIN NAMESPACE EXPECTED SECONDS STOP

Makes the file STOP when it has received enough: then the publisher must stop, and the middleware must tell so.
"""

import pathlib
import sys
import time

from cyclonedds.core import Listener
from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from expected import Expected
from messages import RELIABLE, SENSOR, WATCHED, DiagnosticArray, Image, PointCloud2, WrenchStamped


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
