"""A run as one MCAP file, which viewers and ROS 2 read: topics, schemas, and messages in CDR."""
