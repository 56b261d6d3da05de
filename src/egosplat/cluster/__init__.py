"""What a job of each stage is expected to need of the machine that it runs on."""
