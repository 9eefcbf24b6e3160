"""The formats a route can come from, one file each; `folder` is the one all of everplace works on."""
