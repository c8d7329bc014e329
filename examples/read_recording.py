"""Read the contacts of a recording of `dermis live --record` without ROS and without Dermis.

python read_recording.py RECORDING.mcap      (pip install rosbags numpy)
"""

import sys
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

# NumPy's names of the two PointField types that occur.
FORMATS = {6: "<u4", 7: "<f4"}


def contacts(message):
    """The points of a PointCloud2 as a structured array with the fields of the table in docs/file-formats.md."""
    layout = np.dtype({
        "names": [field.name for field in message.fields],
        "formats": [FORMATS[field.datatype] for field in message.fields],
        "offsets": [field.offset for field in message.fields],
        "itemsize": message.point_step,
    })
    return np.frombuffer(bytes(message.data), layout)


def main():
    store = get_typestore(Stores.ROS2_JAZZY)
    frames, touched, ids = 0, 0, set()
    with Reader(Path(sys.argv[1])) as reader:
        selected = [connection for connection in reader.connections if connection.topic == "/dermis/contacts"]
        for connection, time_ns, data in reader.messages(connections=selected):
            found = contacts(store.deserialize_cdr(data, connection.msgtype))
            frames += 1
            touched += len(found) > 0
            for contact in found:
                if int(contact["id"]) not in ids:
                    ids.add(int(contact["id"]))
                    place = ", ".join(f"{1e3 * contact[axis]:.1f}" for axis in "xyz")
                    print(f"{time_ns * 1e-9:.3f} s: contact {contact['id']} at ({place}) mm, {contact['force']:.2f} N")
    print(f"{frames} frames, {touched} with contacts, {len(ids)} contacts")


if __name__ == "__main__":
    main()
