"""What each command does: from its options to files, figures and lines to print."""
