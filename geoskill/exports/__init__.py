"""What is selected and commanded, in the forms in which other programs take it: files, and messages while it runs."""
