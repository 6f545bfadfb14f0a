"""Expression and heart rate to an affective state, with the reasons."""
