// SPDX-License-Identifier: Apache-2.0
/* half: conversion of 16-bit floats (IEEE 754 binary16). Pure functions. */
#ifndef HEXAD_IO_POINTS_HALF_H
#define HEXAD_IO_POINTS_HALF_H

#include <stdint.h>

uint16_t half_from_float(float value); /* rounded to nearest even */
float half_to_float(uint16_t half);

#endif
