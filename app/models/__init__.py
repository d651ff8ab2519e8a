"""One module per model that `pricing simulate` reads; see `app.model_files`."""
