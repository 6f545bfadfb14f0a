"""Any stream of the Lab Streaming Layer as a sensor, with the sender's clock measured both ways."""
