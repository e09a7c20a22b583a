"""The hub: which frames go to which links."""
