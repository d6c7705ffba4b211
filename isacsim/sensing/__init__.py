"""What the network knows of a vehicle: the sensing chain, the sensors, and the reports of connected vehicles."""
