"""What commands send to fly, and when their goals are reached."""
