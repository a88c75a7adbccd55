"""What the flight computer believes of vehicle, planet and air."""
