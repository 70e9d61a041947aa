"""The node `track_initiator`."""
