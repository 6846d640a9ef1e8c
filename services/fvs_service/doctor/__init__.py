"""``fvs doctor`` finds and repairs what crashes, full disks and restored backups leave behind."""
