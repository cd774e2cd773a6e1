"""The application in the browser: simulate above, look below.

- `source`, `changes`, `settings`: where a scene comes from, what the form changes of it, and the
  scene that it says.
- `store`: the folder below which alone the application reads and writes.
- `processes`, `worker`, `tasks`: long work, in processes of their own.
- `access`: who may ask for pages.
- `charts`: figures over time, and the contact matrix.
- `server`, `upper` with its `form`, `lower`: the page.
"""
