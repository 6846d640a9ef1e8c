"""A simulated vehicle that speaks MAVLink as an ArduCopter does. Needs pymavlink."""
