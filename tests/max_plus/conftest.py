from pricing_core import kernel_name

# Nothing here uses the compiled kernel: it is tested once, not once more on the kernel's twin.
collect_ignore_glob = [] if kernel_name() == "rust" else ["*"]
