# SPDX-License-Identifier: BSD-3-Clause
"""ros2 launch dsorb_ros dsorb.launch.py camera:=/camera [params:=FILE.yaml]"""
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    camera = LaunchConfiguration('camera')
    topics = [(ours, [camera, theirs]) for ours, theirs in
              (('image', '/image_raw'), ('image/compressed', '/image_raw/compressed'), ('camera_info', '/camera_info'))]
    params = PathJoinSubstitution([FindPackageShare('dsorb_ros'), 'config', 'dsorb.yaml'])
    return LaunchDescription([
        DeclareLaunchArgument('camera', default_value='/camera'),
        DeclareLaunchArgument('params', default_value=params),
        Node(package='dsorb_ros', executable='dsorb_node', name='dsorb', output='screen', remappings=topics,
             parameters=[LaunchConfiguration('params')]),
    ])
