"""ros2 launch everplace_ros localize.launch.py map:=my-map image:=/camera/image_raw."""

from __future__ import annotations

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """The node, with what a robot has to say of itself as arguments."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("map", description="Directory of `everplace map create`"),
            DeclareLaunchArgument("image", default_value="/camera/image_raw", description="Topic of sensor_msgs/Image"),
            DeclareLaunchArgument("sequence", default_value="10", description="Frames that an answer rests on"),
            DeclareLaunchArgument("precision", default_value="0.99", description="Share of poses that shall be right"),
            DeclareLaunchArgument("frame_id", default_value="map", description="Coordinate frame of the map's poses"),
            Node(
                package="everplace_ros",
                executable="localize",
                name="everplace",
                output="screen",
                remappings=[("image", LaunchConfiguration("image"))],
                parameters=[
                    {
                        "map": LaunchConfiguration("map"),
                        "sequence": ParameterValue(LaunchConfiguration("sequence"), value_type=int),
                        "precision": ParameterValue(LaunchConfiguration("precision"), value_type=float),
                        "frame_id": LaunchConfiguration("frame_id"),
                    }
                ],
            ),
        ]
    )
