#!/bin/bash -eu
# Builds both targets with the flags and the engine that OSS-Fuzz gives; the vectors are the corpus that they begin with.
cmake -S core -B build/oss-fuzz -G Ninja -DPDEANIM_FUZZ=ON -DPDEANIM_LIBRARY=OFF -DCMAKE_BUILD_TYPE=Debug \
    -DPDEANIM_FUZZ_ENGINE="$LIB_FUZZING_ENGINE"
cmake --build build/oss-fuzz --target fuzz_open fuzz_interface
python3 -m spec.vector_files build/vectors
for target in fuzz_open fuzz_interface; do
    cp "build/oss-fuzz/$target" "$OUT/"
    zip -j -q "$OUT/${target}_seed_corpus.zip" build/vectors/*/*.pdeanim
done
