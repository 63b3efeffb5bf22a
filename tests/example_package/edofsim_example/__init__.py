"""One of each kind of thing that edofsim lets other packages add, a file each."""
