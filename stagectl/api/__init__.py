"""What `import stagectl` offers: nine functions and their results.  The command line is made of the same."""
