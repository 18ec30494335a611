"""What was heard on a line, as data: pieces of bytes with their time, in files that other programs read, too."""
