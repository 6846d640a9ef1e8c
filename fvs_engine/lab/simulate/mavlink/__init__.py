"""A simulated vehicle that speaks MAVLink as an ArduCopter or a PX4 does. Needs pymavlink."""
