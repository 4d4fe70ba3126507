"""Commands of ``python serve.py skill=RUN video=0 drive=true`` for moveit_servo: a node of ROS 2, which has rclpy."""

import json

import rclpy
import zmq
from geometry_msgs.msg import TwistStamped

rclpy.init()
node = rclpy.create_node("geoskill")
publisher = node.create_publisher(TwistStamped, "/servo_node/delta_twist_cmds", 1)
messages = zmq.Context().socket(zmq.SUB)
messages.setsockopt(zmq.CONFLATE, 1)  # the newest message alone
messages.setsockopt(zmq.SUBSCRIBE, b"geoskill ")
messages.connect("tcp://127.0.0.1:5555")
while rclpy.ok() and (twist := json.loads(messages.recv()[len("geoskill ") :]).get("twist")):
    command = TwistStamped()
    command.header.stamp, command.header.frame_id = node.get_clock().now().to_msg(), "base_link"
    for part, numbers in ((command.twist.linear, twist[:3]), (command.twist.angular, twist[3:])):
        part.x, part.y, part.z = numbers
    publisher.publish(command)
