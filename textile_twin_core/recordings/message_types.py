"""ROS names of the message types that recordings and nodes read and write."""

JOINT_STATE = "sensor_msgs/msg/JointState"
WRENCH = "geometry_msgs/msg/WrenchStamped"
POINT = "geometry_msgs/msg/PointStamped"
FLOAT64 = "std_msgs/msg/Float64"
HEADER = "std_msgs/msg/Header"
