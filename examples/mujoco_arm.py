"""An arm in MuJoCo whose forearm wears `cylinder30`: a finger presses it, the skin finds the presses.

python examples/mujoco_arm.py [--presses 100] [--method spots]      (pip install './dermis-python[mujoco]')

Every press has a random place and a force of 2 to 5 N, and lasts ten frames of the skin while the arm moves. The contacts of
the simulator press a digital twin of the skin (uneven coat, electrodes off their places, noise, drift); the network or the
linear method knows nothing of it.
"""

import argparse
import time

import mujoco
import numpy as np

import dermis
from dermis.mujoco import SimulatedSkin

ARM = """
<mujoco>
  <option timestep="0.0005"/>
  <worldbody>
    <body pos="0 0 0.3">
      <joint name="shoulder" axis="0 1 0" damping="20"/>
      <geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.04" mass="2"/>
      <body pos="0.27 0 0">
        <joint name="elbow" axis="0 1 0" damping="20"/>
        <body pos="0.17 0 0" euler="0 90 0">
          <geom name="forearm" type="cylinder" size="0.05 0.15" mass="1"/>
        </body>
      </body>
    </body>
    <body name="finger" gravcomp="1">
      <joint type="slide" axis="1 0 0" damping="2"/>
      <joint type="slide" axis="0 1 0" damping="2"/>
      <joint type="slide" axis="0 0 1" damping="2"/>
      <geom name="tip" type="sphere" size="0.008" mass="0.02" friction="2"/>
    </body>
  </worldbody>
  <actuator>
    <position joint="shoulder" kp="400"/>
    <position joint="elbow" kp="400"/>
  </actuator>
</mujoco>
"""
FRAMES = 10
SETTLE_S = 0.15


def press(model, data, sensor, place, force_n):
    """Presses the finger on a place of the skin; yields frames and the true presses."""
    worn, tip = sensor.worn, model.geom("tip").size[0]
    radius = np.hypot(*place[:2])
    outward = np.array([place[0] / radius, place[1] / radius, 0.0])
    at = worn.to_world(data, place + (tip + 0.0005) * outward)
    first = model.joint(model.body("finger").jntadr[0]).qposadr[0]
    data.qpos[first : first + 3], data.qvel[first : first + 3] = at, 0

    def advance(duration_s):
        end_s = data.time + duration_s
        while data.time < end_s:
            data.ctrl[:] = 0.3 * np.sin(0.4 * data.time), 0.4 * np.sin(0.3 * data.time)
            axis = data.geom_xmat[worn.geom].reshape(3, 3) @ (worn.rotation @ outward)
            data.xfrc_applied[model.body("finger").id, :3] = -force_n * axis
            mujoco.mj_step(model, data)

    advance(SETTLE_S)
    for _ in range(FRAMES):
        advance(1 / sensor.frame_rate_hz)
        yield sensor.sense(data), worn.touches(data)
    # The finger leaves, and the skin is untouched for a moment.
    data.qpos[first : first + 3] = worn.to_world(data, place + 0.2 * outward)
    data.xfrc_applied[:] = 0
    for _ in range(FRAMES):
        data.qvel[first : first + 3] = 0
        mujoco.mj_step(model, data)
        sensor.sense(data)


def run(presses, method, seed=1, report=print):
    """Presses the arm; returns the share of presses found, the mean error (m), and frames per second of the skin."""
    model = mujoco.MjModel.from_xml_string(ARM)
    data = mujoco.MjData(model)
    skin = dermis.Skin.load("cylinder30")
    sensor = SimulatedSkin(skin, model, "forearm", method=method, twin="lab", seed=seed)
    random = np.random.default_rng(seed)
    for _ in range(500):
        mujoco.mj_step(model, data)
    errors, found, sensing_s, frames = [], 0, 0.0, 0
    for number in range(presses):
        z, theta, force_n = random.uniform(0.03, 0.27), random.uniform(-np.pi, np.pi), random.uniform(2, 5)
        place = np.array([0.05 * np.cos(theta), 0.05 * np.sin(theta), z])
        best = np.inf
        begun = time.perf_counter()
        for frame, touches in press(model, data, sensor, place, force_n):
            frames += 1
            if len(frame.contacts) and len(touches.forces_n):
                best = np.linalg.norm(frame.contacts.position_m[:, None] - touches.positions_m, axis=2).min()
        sensing_s += time.perf_counter() - begun
        if best < 0.02:
            found += 1
            errors.append(best)
        else:
            report(f"press {number} at z {1e3 * z:.0f} mm, {force_n:.1f} N: not found")
    share, mean_m = found / presses, float(np.mean(errors))
    report(
        f"{method or 'default method'}: {found} of {presses} presses found, mean error {1e3 * mean_m:.2f} mm, "
        f"{2 * frames / sensing_s:.0f} frames a second, physics and twin included"
    )
    return share, mean_m


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--presses", type=int, default=100)
    parser.add_argument("--method", default="spots")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    run(given.presses, given.method, given.seed)


if __name__ == "__main__":
    main()
