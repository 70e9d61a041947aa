"""What track initiation methods share."""
