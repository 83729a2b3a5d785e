// Runs the fuzz target on files, and on a number of mutants of each: mutants N FILE...
//
// For use with sanitizers on systems without libFuzzer. The mutants are the same in every run.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size);

namespace {

using Bytes = std::vector<std::uint8_t>;

// Pseudo-random numbers (Marsaglia 2003, "Xorshift RNGs").
class Random {
public:
    std::uint64_t below(std::uint64_t end) {
        state_ ^= state_ << 13;
        state_ ^= state_ >> 7;
        state_ ^= state_ << 17;
        return state_ % end;
    }

private:
    std::uint64_t state_ = 88172645463325252u;
};

Bytes read(const char *path) {
    std::FILE *file = std::fopen(path, "rb");
    if (!file) {
        std::perror(path);
        std::exit(EXIT_FAILURE);
    }
    Bytes data;
    for (int byte = std::fgetc(file); byte != EOF; byte = std::fgetc(file))
        data.push_back(static_cast<std::uint8_t>(byte));
    std::fclose(file);
    return data;
}

// Make one to three changes: a byte, a bit, a run of one value, a piece copied from elsewhere, or the end cut off.
void mutate(Bytes &data, Random &random) {
    for (std::uint64_t changes = 1 + random.below(3); changes > 0 && !data.empty(); --changes) {
        const std::size_t at = random.below(data.size()), left = data.size() - at;
        const std::size_t count = 1 + random.below(left < 8 ? left : 8);
        switch (random.below(8)) {
            case 0:
            case 1:
            case 2: data[at] = static_cast<std::uint8_t>(random.below(256)); break;
            case 3:
            case 4: data[at] ^= static_cast<std::uint8_t>(1u << random.below(8)); break;
            case 5:
                for (std::size_t k = 0; k < count; ++k) data[at + k] = random.below(2) ? 0xFF : 0;
                break;
            case 6: {
                const std::size_t from = random.below(data.size() - count + 1);
                for (std::size_t k = 0; k < count; ++k) data[at + k] = data[from + k];
                break;
            }
            default: data.resize(at);
        }
    }
}

}  // namespace

int main(int count, char **arguments) {
    if (count < 3) {
        std::fprintf(stderr, "usage: %s MUTANTS FILE...\n", arguments[0]);
        return EXIT_FAILURE;
    }
    std::vector<Bytes> files;
    for (int k = 2; k < count; ++k) files.push_back(read(arguments[k]));
    for (const Bytes &file : files) LLVMFuzzerTestOneInput(file.data(), file.size());
    Random random;
    const long mutants = std::atol(arguments[1]);
    for (long k = 0; k < mutants; ++k) {
        Bytes mutant = files[random.below(files.size())];
        mutate(mutant, random);
        // A copy of exactly the file's size, so that sanitizers notice reads beyond its end.
        const Bytes exact(mutant.begin(), mutant.end());
        LLVMFuzzerTestOneInput(exact.data(), exact.size());
    }
    std::printf("%zu files and %ld mutants\n", files.size(), mutants);
    return EXIT_SUCCESS;
}
