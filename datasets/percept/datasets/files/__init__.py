"""Folders and single files of point clouds and images as recordings."""
