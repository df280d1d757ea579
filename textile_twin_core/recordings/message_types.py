"""The message types that recordings and nodes read and write, by their names in ROS."""

JOINT_STATE = "sensor_msgs/msg/JointState"
WRENCH = "geometry_msgs/msg/WrenchStamped"
POINT = "geometry_msgs/msg/PointStamped"
FLOAT64 = "std_msgs/msg/Float64"
HEADER = "std_msgs/msg/Header"
