"""From a plan of jobs to finished jobs: in this process, or in processes of their own."""
