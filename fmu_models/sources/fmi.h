/* FMI 2.0 and FMI 3.0 co-simulation over the plant above: the last include of a model file. */
#include "instance.h"

#include "fmi2.h"
#include "fmi3.h"
