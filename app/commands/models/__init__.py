"""One module per model that `pricing simulate` reads; see `app.commands.model_files`."""
