"""Independent reference of the stick-slip haptic simulation, after Jacobs & Cavusoglu. "(n)" is the paper's equation n."""
