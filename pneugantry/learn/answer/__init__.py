"""What a learnt term says: to the diagnosis, to a report, to the next rig."""
