"""What a twin tells about its machine: the generalised disturbance, its decomposition, structural modes."""
