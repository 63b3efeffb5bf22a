"""A benchmark that others can enter: what it is made of, who enters, how entries are scored."""
