// Lists of whole numbers: ascending ones, and those that come in runs.
#pragma once

#include <span>

#include "entropy/match_model.hpp"
#include "entropy/numbers.hpp"

namespace pdeanim {

// Numbers of which each is larger than the one before, by no more than 2^32.
class AscendingModel {
public:
    template <Mode mode> void code(RangeCoder<mode> &coder, std::span<i64> numbers) {
        for (std::size_t i = 0; i < numbers.size(); ++i) {
            coder.check_not_ended();
            if (i == 0) {
                numbers[0] = first_.code(coder, numbers[0]);
            } else {
                numbers[i] = numbers[i - 1] + 1 + gaps_.code(coder, numbers[i] - numbers[i - 1] - 1);
            }
        }
    }

private:
    SignedModel first_;
    NumberModel gaps_;
};

// Numbers by their differences, less than 2^32 in size, which often come again as they came before.
class StepModel {
public:
    template <Mode mode> void code(RangeCoder<mode> &coder, std::span<i64> numbers) {
        i64 last = 0;
        for (i64 &number : numbers) {
            const std::optional<i64> again = match_.code(coder, 0, number - last);
            const i64 step = again ? *again : steps_.code(coder, number - last);
            match_.add(step);
            last += step;
            number = last;
        }
    }

private:
    SignedModel steps_;
    MatchModel match_;
};

}  // namespace pdeanim
