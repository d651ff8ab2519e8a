"""What the subcommands of `pricing` do: files and models in, tables and pictures out."""
