"""What has changed since a twin of several days: every cause is judged by one score on all that was recorded."""
