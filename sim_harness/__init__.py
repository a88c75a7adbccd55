"""The world the flight computer is tested in: vehicle, navigation, actuators, bus, recorder."""
