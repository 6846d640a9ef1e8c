"""``fvs doctor``: finds what crashes, full disks and restored backups leave behind, and mends it."""
