"""What is measured of fields: volumes, shapes, surfaces, contacts, aggregates."""
