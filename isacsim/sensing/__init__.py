"""What the network knows of a vehicle: the sensing chain, the sensors, and the reports of connected vehicles.

In come the true motion of vehicles, and the sites; out come states as the network knows them and as vehicles report
them.
"""
