"""Raw streams, features and markers as outlets of the Lab Streaming Layer."""
