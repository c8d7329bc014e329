# The skin with its contacts in RViz: ros2 launch robot/skin.launch.py
# With the reader: ros2 launch robot/skin.launch.py design:=my-skin.toml source:=serial:/dev/ttyACM0
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import Node

FOLDER = Path(__file__).resolve().parent
FRAME = "{frame}"


def generate_launch_description():
    base = (FOLDER.parent / "base.stl").as_uri()
    description = (FOLDER / "skin.urdf").read_text(encoding="utf-8").replace("../base.stl", base)
    source = LaunchConfiguration("source")
    return LaunchDescription([
        DeclareLaunchArgument("design", default_value={design}, description="design of the skin, a file or a shipped name"),
        DeclareLaunchArgument("source", default_value="", description="source of `dermis live`; empty: it runs elsewhere"),
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            parameters=[{{"robot_description": description}}],
        ),
        Node(package="rviz2", executable="rviz2", arguments=["-d", str(FOLDER / "skin.rviz"), "-f", FRAME]),
        ExecuteProcess(
            cmd=["dermis", "live", LaunchConfiguration("design"), "--ros2", "--frame-id", FRAME, "--source", source],
            output="screen",
            condition=IfCondition(PythonExpression(["'", source, "' != ''"])),
        ),
    ])
